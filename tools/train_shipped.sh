#!/usr/bin/env bash
# From random numbers to a weights file like the one that is shipped, in one command.
#
#   tools/train_shipped.sh MESHES PHOTOS OUTPUT [options of `moveit6d fit`]
#
# The fit of configs/fit/compact.yaml, then its confidence for searches, then the regressions of
# probabilities, which are printed: they belong into `VerificationConfig`, `StateConfig` and
# `SingleImageConfig`. OUTPUT/multi_object.safetensors is the file. Kill it at any time; the same
# command goes on. With `--config configs/overlay/gpu_pairs.yaml` the fit is the shipped weights' own.
set -euo pipefail
if (($# < 3)); then
    sed -n '2,9s/^# \{0,1\}//p' "$0"
    exit 2
fi
meshes=$(realpath "$1") photos=$(realpath "$2") output=$(realpath -m "$3")
shift 3
cd "$(dirname "${BASH_SOURCE[0]}")/.."
python=${PYTHON:-.venv/bin/python}
# What the later parts need of the fit's options, which are refused now where they cannot do with it.
files=$("$python" -m tools.training_files --config configs/fit/compact.yaml "$@" \
    --data.meshes "$meshes" --data.photos "$photos" --output "$output")
"$python" -m moveit6d fit --config configs/fit/compact.yaml "$@" \
    --data.meshes "$meshes" --data.photos "$photos" --output "$output"
"$python" -m tools.fit_search_head --meshes "$meshes" --photos "$photos" $files --jobs 2 \
    --weights "$output/weights.safetensors" --output "$output/multi_object.safetensors" \
    --outcomes "$output/outcomes"
"$python" -m tools.fit_probabilities --meshes "$meshes" --photos "$photos" $files --jobs 2 \
    --weights "$output/multi_object.safetensors"
