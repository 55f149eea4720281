#!/usr/bin/env bash
# Measure the shipped model on the evaluation data and write docs/results/ anew.
#
#   tools/results.sh SHARED [sequences|videos|images|rendered|cycle|oracle ...]
#
# SHARED holds bench/ and data/ (see docs/results/README.md). Without names, all of them: about half
# an hour on two cores. Nothing of this data is used for training.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
shared=$1
shift
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

run() { # shows a command as a reader would type it, then what it prints
    local words="$*"
    words=${words//$shared/SHARED}
    printf '```sh\nmoveit6d %s\n```\n\n' "${words//$work/OUT}"
    .venv/bin/moveit6d "$@" | sed "s#$work/##g"
    printf '\n'
}
plain() { # the same for output that is no Markdown
    run "$@" | sed '4s/^/```text\n/; $s/$/```/'
}

sequences() {
    printf '# Synthetic sequences, no reset\n\n'
    run benchmark tracking --sequences "$shared/bench/sequences" --rivals "$shared/bench/rivals" \
        --per_sequence
}
videos() {
    printf '# Real videos, no reset\n\n'
    run benchmark tracking --sequences "$shared/data/real" --rivals "$shared/bench/rivals_real"
}
images() {
    local data=$shared/data/real/lmo_dev start
    printf '# Single images: Linemod-Occlusion, every second BOP test image\n\n'
    for start in small large keypoint_rgb; do
        cp "$data/initial_$start.csv" "$work/initial_$start.csv"
        run refine --dataset "$data" --split test --initial "$work/initial_$start.csv" \
            --output "$work/refined_$start.csv"
        run evaluate bop --dataset "$data" --split test \
            --results "$work/initial_$start.csv" "$work/refined_$start.csv"
    done
}
rendered() {
    local start
    printf '# Rendered objects that were never trained on\n\n'
    for start in "all_small 0" "all_large 0" "all_large 1"; do
        plain benchmark rendered --objects "$shared/data/dev_objects" \
            --photos "$shared/data/dev_photos" --cluster "${start% *}" --covered "${start#* }"
    done
}
cycle() {
    printf '# Time of one cycle\n\n'
    plain benchmark cycle
    plain benchmark cycle --threads 2
}
oracle() {
    printf '# Proof of the loop: a policy that knows the truth\n\n'
    plain benchmark oracle --starts 1000
    plain benchmark oracle --starts 100 --renderer pyrender  # software OpenGL is slow
}

for name in "${@:-sequences videos images rendered cycle oracle}"; do
    for section in $name; do
        "$section" >"$work/$section.md"
        mv "$work/$section.md" "docs/results/$section.md"
    done
done
