#!/usr/bin/env bash
# The shipped model from random numbers.
#
#   tools/train_shipped.sh MESHES PHOTOS OUTPUT [OPTION ...]
#
# Three fits, each from the weights of the one before, and the calibration of the confidence before
# the last: about six hours of two CPU cores. Options go to all fits. Kill it at any time: the same
# command goes on. OUTPUT/third/weights.safetensors is the result; the regressions that the
# calibration prints are those of `VerificationConfig` and `StateConfig`.
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
[ -e "$output/calibrated.safetensors" ] ||
    PYTHONPATH=. .venv/bin/python tools/fit_probabilities.py --meshes "$meshes" --photos "$photos" \
        --jobs 2 --weights "$output/second/weights.safetensors" \
        --calibrated "$output/calibrated.safetensors"
fit third --config configs/overlay/poor_textures.yaml --config configs/overlay/slender.yaml \
    --model.init_from "$output/calibrated.safetensors" "$@"
