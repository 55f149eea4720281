#!/usr/bin/env bash
# The shipped model from random numbers.
#
#   tools/train_shipped.sh MESHES PHOTOS OUTPUT [OPTION ...]
#
# One fit, and the calibration of its confidence. Options go to the fit; with
#   --config configs/overlay/gpu_pairs.yaml
# it takes ten minutes of a data-centre GPU, as the shipped weights did; without, three and a half
# hours of two CPU cores, for a network that is a little less exact (docs/experiments/training.md).
# Kill it at any time: the same command goes on. OUTPUT/weights.safetensors is the result; the
# regressions that the calibration prints are those of `VerificationConfig` and `StateConfig`.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
meshes=$1 photos=$2 output=$3
shift 3

if [ ! -e "$output/fit/done" ]; then
    .venv/bin/moveit6d fit --config configs/fit/compact.yaml "$@" \
        --data.meshes "$meshes" --data.photos "$photos" --output "$output/fit"
    touch "$output/fit/done"
fi
PYTHONPATH=. .venv/bin/python tools/fit_probabilities.py --meshes "$meshes" --photos "$photos" \
    --jobs 2 --weights "$output/fit/weights.safetensors" --calibrated "$output/weights.safetensors"
