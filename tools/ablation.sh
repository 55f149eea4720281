#!/usr/bin/env bash
# The paper's policy and ours, and ours in parts, trained on the same pairs for the same steps.
#
#   tools/ablation.sh MESHES PHOTOS OBJECTS BACKGROUNDS OUTPUT [STEPS]
#
# Trains on the meshes of MESHES before the pictures of PHOTOS and measures on OBJECTS before
# BACKGROUNDS, which are other ones. Two networks are trained beside each other, on a core each.
# What OUTPUT already holds is not made again: a killed run goes on. 500 steps by default: an hour.
set -euo pipefail
if (($# < 5)); then
    sed -n '2,8s/^# \{0,1\}//p' "$0"
    exit 2
fi
cd "$(dirname "${BASH_SOURCE[0]}")/.."
meshes=$1 photos=$2 objects=$3 backgrounds=$4 output=$5 steps=${6:-500}
correlation=configs/fit/multi_object_correlation.yaml
data=("data.meshes=$meshes" "data.photos=$photos" data.rollouts=null data.shapes=40)

moveit6d() { .venv/bin/moveit6d "$@"; }

write() { # FOLDER [CONFIG …]: the pairs that every network of a group is given
    local folder=$1 sets=() configs=()
    for one in "${data[@]}"; do sets+=(--set "$one"); done
    for one in "$correlation" "${@:2}"; do configs+=(--config "$one"); done
    moveit6d write-pairs "${configs[@]}" "${sets[@]}" --output "$folder" --shards 16 --batches 20 \
        --seed 0 >&2
}
train() { # NAME RATE MATCHING_STEPS CONFIG … -- OPTION …: weights in OUTPUT/NAME
    local name=$1 rate=$2 matching=$3 configs=() sizes=()
    [ "$name" = paper ] || sizes=(--model.network.init_args.config.extra_blocks '[0, 0, 0]')
    shift 3
    [ -e "$output/$name/done" ] && return
    while [ "$1" != -- ]; do configs+=(--config "$1") && shift; done
    moveit6d fit "${configs[@]}" --threads 1 --data.workers 0 --model.learning_rate "$rate" \
        --model.schedule cosine --model.total_steps "$steps" --model.matching_steps "$matching" \
        --trainer.max_steps "$steps" --trainer.limit_val_batches 0 --trainer.logger false \
        --output "$output/$name" --checkpoint.every_n_train_steps 50 --export.every_n_steps 50 \
        "${sizes[@]}" "${@:2}" >&2
    touch "$output/$name/done"
}
written() { # NAME RATE PAIRS SEED CONFIG …: trained on pairs that were written
    train "$1" "$2" 200 "${@:5}" -- --data.written "$3" --data.rollouts null --data.seed "$4" \
        --seed_everything "$4"
}
drawn() { # NAME CYCLES: as many steps more of `correlation`, on pairs that are drawn as it goes
    train "$1" 5e-4 0 "$correlation" -- --model.init_from "$output/correlation/weights.safetensors" \
        --data.meshes "$meshes" --data.photos "$photos" --data.shapes 40 --data.seed 2 \
        --data.rollouts.iterations "$2"
}
measure() { # NAME FOLDER [OPTION …]: a row of the table
    local name=$1 weights=$output/$2/weights.safetensors small large
    small=$(figures "$weights" all_small "${@:3}")
    large=$(figures "$weights" all_large "${@:3}")
    printf '| %s | %s | %s |\n' "$name" "$small" "$large"
}
figures() { # WEIGHTS CLUSTER [OPTION …]: ADD < 5 %, < 10 %, median steps, AUROC of the confidence
    moveit6d benchmark refinement --weights "$1" --objects "$objects" --photos "$backgrounds" \
        --cluster "$2" --gamma 1 --no_contour --no_multi_start --threads 1 "${@:3}" |
        awk '/^after/ { five = $3; ten = $4 } /^iterations/ { median = $NF } /^confidence/ { auc = $3 }
             END { print five " | " ten " | " median " | " auc }'
}

mkdir -p "$output"
axis=configs/overlay/axis_parallel.yaml
write "$output/pairs" &
write "$output/pairs_axis" "$axis" &
wait
written correlation 1.5e-3 "$output/pairs" 0 "$correlation" &
written axis_parallel 1.5e-3 "$output/pairs_axis" 0 "$correlation" "$axis" &
wait
drawn more 0 &
drawn own_states 3 &
wait
written again 1.5e-3 "$output/pairs" 1 "$correlation" &
written no_depth 1.5e-3 "$output/pairs" 0 "$correlation" configs/overlay/no_depth.yaml &
wait
written paper 5e-4 "$output/pairs" 0 configs/fit/multi_object.yaml

printf '# The paper'"'"'s policy and ours on the same pairs\n\n`tools/ablation.sh`, %s steps. ' "$steps"
printf 'Rendered objects, ADD below 5 and 10 %% of the diameter, median of the steps, AUROC of the '
printf 'confidence; no outline, no other starts.\n\n'
printf '| network | small: < 5 %% | < 10 %% | steps | AUROC | large: < 5 %% | < 10 %% | steps | AUROC |\n'
printf '|---|---|---|---|---|---|---|---|---|\n'
rows() {
    measure "correlation, all six axes" correlation
    measure "the same, other seed" again
    measure "the same, single actions" correlation --mode single
    measure "correlation without depth" no_depth
    measure "correlation, axis-parallel crops" axis_parallel
}
more_rows() {
    measure "correlation, as many steps more" more
    measure "the same, half of them on the network's own states" own_states
    measure "the paper's, many objects, single actions" paper
}
more_rows > "$output/rows" &
rows
wait
cat "$output/rows"
