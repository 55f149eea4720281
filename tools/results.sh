#!/usr/bin/env bash
# Measure the shipped model on the evaluation data and write docs/results/ anew.
#
#   tools/results.sh SHARED [sequences|videos|images|refinement|options|single_actions|no_depth|
#                            paper_network|surrogates|iteration|oracle ...]
#
# SHARED holds bench/ and data/ (see docs/results/README.md). Without names, all of them: about an
# hour on two cores. Nothing of this data is used for training.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
shared=$1
shift
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

larger=(--weights examples/correlation/multi_object.safetensors)
colours=(--gamma 1)  # as in the pairs that all networks but the shipped one were trained with

run() { # a verb, shown and run
    shown moveit6d "$@"
    .venv/bin/moveit6d "$@" | sed "s#$work/##g"
    printf '\n'
}
shown() { # a command as a reader would type it
    local words="$*"
    words=${words//$shared/SHARED}
    printf '```sh\n%s\n```\n\n' "${words//$work/OUT}"
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
    run refine --dataset "$data" --split test --initial "$work/initial_small.csv" --no_contour \
        --output "$work/small_without_outline.csv"
    run evaluate bop --dataset "$data" --split test --results "$work/small_without_outline.csv"
    for start in refined_small small_without_outline; do
        contrast "$data" test "$work/$start.csv"
    done
}
contrast() { # whether these poses or the true ones fit the pictures better
    shown .venv/bin/python tools/contour_contrast.py "$@"
    .venv/bin/python tools/contour_contrast.py "$@"
    printf '\n'
}
refinement() {
    printf '# Rendered objects that were never trained on\n\n'
    printf 'At their edges light mixes as in a camera; in the last three colours do (`--gamma 1`).\n\n'
    all_refinement
    all_refinement "${colours[@]}"
}
all_refinement() { # [OPTION …]
    local start
    for start in "all_small 0" "all_large 0" "all_large 1"; do
        one_refinement "$start" "$@"
    done
}
both_tracked() { # OPTION …: made and real sequences, without rivals
    run benchmark tracking --sequences "$shared/bench/sequences" "$@" --jobs 2
    run benchmark tracking --sequences "$shared/data/real" "$@" --jobs 2
}
one_refinement() { # "CLUSTER COVERED" and further options
    plain benchmark refinement --objects "$shared/data/dev_objects" \
        --photos "$shared/data/dev_photos" --cluster "${1% *}" --occluded "${1#* }" "${@:2}"
}
options() {
    local start
    printf '# What single options bring\n\nThe larger network of `examples/correlation`, one option changed at a time: the paper'"'"'s single '
    printf 'actions, no multi-start refinement, no calibration, and neither calibration nor contour refinement.\n\n'
    for start in "all_small 0" "all_large 0"; do
        one_refinement "$start" --no_contour "${larger[@]}" "${colours[@]}"
        one_refinement "$start" --no_contour --mode single "${larger[@]}" "${colours[@]}"
    done
    one_refinement "all_large 1" --no_multi_start "${larger[@]}" "${colours[@]}"
    run benchmark tracking --sequences "$shared/bench/sequences" --no_calibration "${larger[@]}"
    run benchmark tracking --sequences "$shared/bench/sequences" --no_calibration --no_contour \
        "${larger[@]}"
}
single_actions() {
    local data=$shared/data/real/lmo_dev start
    local mode=(--mode single --no_contour "${larger[@]}")
    printf '# The paper'"'"'s policy: one of 13 actions an iteration\n\nThe larger network of '
    printf '`examples/correlation` without what goes past the paper: contour refinement, multi-start refinement and calibration.\n\n'
    both_tracked "${mode[@]}" --no_calibration
    for start in small large keypoint_rgb; do
        run refine --dataset "$data" --split test --initial "$data/initial_$start.csv" \
            --output "$work/$start.csv" "${mode[@]}" --jobs 2
        run evaluate bop --dataset "$data" --split test --results "$work/$start.csv"
    done
}
no_depth() {
    local weights=(--weights examples/no_depth/multi_object.safetensors)
    printf '# The paper'"'"'s ablation: a network that is not shown depth\n\n'
    all_refinement "${weights[@]}" "${colours[@]}"
    both_tracked "${weights[@]}"
}
paper_network() {
    local weights=(--weights examples/paper_network/multi_object.safetensors) start
    printf '# The paper'"'"'s own network on many objects\n\n'
    printf 'The confidence of these weights (`examples/paper_network`) was not trained: its figures '
    printf 'say nothing.\n\n'
    for start in "one_large 0" "all_small 0" "all_large 0"; do
        one_refinement "$start" "${weights[@]}" "${colours[@]}" --no_contour --max_iterations 150
    done
    run benchmark tracking --sequences "$shared/bench/sequences" "${weights[@]}" --no_contour \
        --no_calibration --jobs 2
    printf '## The paper'"'"'s tables on surrogates for its data sets\n\n'
    surrogate_data
    printf 'Rows of objects that only the paper has are left out.\n\nThe paper'"'"'s network:\n\n'
    paper_tables paper "${weights[@]}"
    printf 'The shipped network, single actions as well:\n\n'
    paper_tables shipped
}
paper_tables() { # NAME OPTION …
    local only_theirs='^\| [^|]*\|( [TR] [a-z]+ \|)? +- \|'
    reproduce ycb_add --data "$work/ycbv" --output "$work/$1" "${@:2}" | sed -E "/$only_theirs/d"
    reproduce laval --data "$work/laval" --output "$work/$1" "${@:2}" | sed -E "/$only_theirs/d"
}
surrogate_data() { # rendered objects in the formats of Laval and YCB-Video
    local objects=$shared/data/dev_objects
    surrogate laval --format laval --frames 45 \
        --mesh "$objects/gso_boot.glb" "$objects/gso_dino_figure.glb" \
        --photos "$shared/data/dev_photos"
    surrogate ycbv --format ycbv --count 3 --difficulty easy --frames 40 \
        --mesh "$objects/"{gz_cordless_drill,hope_mustard_bottle,gso_coffee_box,gso_mug_yellow}.glb \
        "$objects/gso_scissors_red.glb" --photos "$shared/data/dev_photos"
}
surrogate() { # NAME OPTION …: made once, its command shown every time
    local words=(synthesize sequence --output "$work/$1" "${@:2}")
    if [ -d "$work/$1" ]; then shown moveit6d "${words[@]}"; else run "${words[@]}"; fi
}
surrogates() {
    local dino=gso_dino_figure_occlusion_0 boot=gso_boot_occlusion_0
    printf '# The paper'"'"'s tables and figures on surrogates\n\n'
    printf 'Rendered objects in the formats of Laval and YCB-Video, not those data sets themselves; with the larger network of '
    printf '`examples/correlation`.\n\n'
    surrogate_data
    reproduce ycb_add --data "$work/ycbv" --output "$work/ycb" "${larger[@]}"
    reproduce ycb_auc --data "$work/ycbv" --output "$work/ycb" "${larger[@]}"
    reproduce laval --data "$work/laval" --output "$work/out" \
        --no_depth_weights examples/no_depth/multi_object.safetensors "${larger[@]}"
    reproduce convergence --data "$work/laval" --only "$dino" --frames 5 --output "$work/out" "${larger[@]}"
    reproduce attention --data "$work/laval" --output "$work/out" "${larger[@]}"
    reproduce detection --data "$work/laval" --only "$dino" "$boot" --frames 1 --rotations 30 \
        --sinks 2 --sizes 0.2 0.3 --output "$work/out" "${larger[@]}"
    reproduce runtime --data "$work/laval" --only "$dino" --output "$work/out" "${larger[@]}"
    mkdir -p docs/results/surrogates
    cp "$work"/{ycb,out}/*.png docs/results/surrogates
}
reproduce() { # its headings one level down, under ours
    run reproduce "$@" | sed 's/^#/##/'
}
iteration() {
    printf '# Time of one iteration\n\n'
    local threads
    for threads in 1 2; do
        plain benchmark iteration --threads "$threads"
        plain benchmark iteration --threads "$threads" --float32
    done
}
oracle() {
    printf '# Proof of the loop: a policy that knows the truth\n\n'
    plain benchmark oracle --starts 1000
    plain benchmark oracle --starts 100 --renderer pyrender  # software OpenGL is slow
}

for name in "${@:-sequences videos images refinement options single_actions no_depth paper_network surrogates iteration oracle}"; do
    for section in $name; do
        "$section" >"$work/$section.md"
        mv "$work/$section.md" "docs/results/$section.md"
    done
done
