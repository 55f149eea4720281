#!/usr/bin/env bash
# The shipped model from random numbers to its calibrated weights.
#
#   tools/train_shipped.sh MESHES PHOTOS OUTPUT [OPTION ...]
#
# Two fits, the second one from the weights of the first, and the calibration of the confidence: about
# six hours of two CPU cores. Options go to both fits. Kill it at any time: the same command goes on.
# OUTPUT/multi_object.safetensors is the result; the regressions that are printed in the end belong
# to it (`VerificationConfig`, `StateConfig`).
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
meshes=$1 photos=$2 output=$3
shift 3

fit() { # NAME OPTION …: weights in OUTPUT/NAME
    [ -e "$output/$1/done" ] && return
    .venv/bin/moveit6d fit --config configs/fit/compact.yaml "${@:2}" \
        --data.meshes "$meshes" --data.photos "$photos" --output "$output/$1"
    touch "$output/$1/done"
}

fit first "$@"
fit second --config configs/overlay/poor_textures.yaml \
    --model.init_from "$output/first/weights.safetensors" "$@"
PYTHONPATH=. .venv/bin/python tools/fit_probabilities.py --meshes "$meshes" --photos "$photos" \
    --jobs 2 --weights "$output/second/weights.safetensors" \
    --calibrated "$output/multi_object.safetensors"
