#!/usr/bin/env bash
# The paper's policy and ours, trained on the same pairs for the same steps: a table.
#
#   tools/ablation.sh MESHES PHOTOS OBJECTS BACKGROUNDS OUTPUT [STEPS]
#
# Trains on the meshes of MESHES before the pictures of PHOTOS and measures on OBJECTS before
# BACKGROUNDS, which are other ones. What OUTPUT already holds is not made again: a killed run goes
# on. 800 steps by default: an hour and a half of one core.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
meshes=$1 photos=$2 objects=$3 backgrounds=$4 output=$5 steps=${6:-800}
singles=(scan_conditioner gz_suv) # of MESHES, for the paper's object-specific training
batches=20                        # a shard
shards=16

moveit6d() { .venv/bin/moveit6d "$@"; }

write() { # FOLDER CONFIG [NAME=VALUE …]: the pairs that every network of a group is given
    local folder=$1 config=$2 sets=()
    shift 2
    for one in "$@"; do sets+=(--set "$one"); done
    moveit6d write-pairs --config "$config" "${sets[@]}" --output "$folder" --shards "$shards" \
        --batches "$batches" --seed 0 >&2
}
train() { # NAME PAIRS RATE CONFIG …: weights in OUTPUT/NAME
    local name=$1 pairs=$2 rate=$3 configs=()
    shift 3
    [ -e "$output/$name/done" ] && return
    for one in "$@"; do configs+=(--config "$one"); done
    moveit6d fit "${configs[@]}" --threads 1 --data.written "$pairs" --data.workers 0 \
        --data.rollouts null --model.learning_rate "$rate" --model.schedule cosine \
        --model.total_steps "$steps" --model.matching_steps 200 --trainer.max_steps "$steps" \
        --trainer.limit_val_batches 0 --trainer.logger false \
        --trainer.default_root_dir "$output/$name" \
        --trainer.callbacks "[{class_path: pytorch_lightning.callbacks.ModelCheckpoint, init_args:
            {dirpath: $output/$name, every_n_train_steps: 100, save_last: true, save_top_k: 0}},
            {class_path: lightning_modules.callbacks.WeightsExport, init_args:
            {folder: $output/$name, every_n_steps: 100}},
            {class_path: lightning_modules.callbacks.FigureLine}]" >&2
    touch "$output/$name/done"
}
measure() { # NAME WEIGHTS OBJECTS [OPTION …]: a row of the table
    local name=$1 weights=$2 folder=$3 small large
    shift 3
    small=$(figures "$weights" "$folder" all_small "$@")
    large=$(figures "$weights" "$folder" all_large "$@")
    printf '| %s | %s | %s |\n' "$name" "$small" "$large"
}
figures() { # WEIGHTS OBJECTS CLUSTER [OPTION …]: ADD < 5 %, < 10 %, median steps
    moveit6d benchmark rendered --weights "$1" --objects "$2" --photos "$backgrounds" \
        --cluster "$3" --no_regions "${@:4}" |
        awk '/^after/ { five = $3; ten = $4 } /^steps/ { median = $NF }
             END { print five " | " ten " | " median }'
}

correlation=configs/fit/multi_object_correlation.yaml
mkdir -p "$output"
write "$output/pairs" "$correlation" data.meshes="$meshes" data.photos="$photos" \
    data.rollouts=null data.shapes=40
train correlation "$output/pairs" 1.5e-3 "$correlation"
train no_depth "$output/pairs" 1.5e-3 "$correlation" configs/overlay/no_depth.yaml
train paper "$output/pairs" 5e-4 configs/fit/multi_object.yaml
for name in "${singles[@]}"; do
    mkdir -p "$output/mesh_$name"
    cp "$meshes/$name".* "$output/mesh_$name"
    write "$output/pairs_$name" configs/fit/object_specific.yaml data.meshes="$output/mesh_$name" \
        data.occluders="$meshes" data.photos="$photos"
    train "paper_$name" "$output/pairs_$name" 5e-4 configs/fit/object_specific.yaml
done

file=weights.safetensors
printf '# The paper'"'"'s policy and ours on the same pairs\n\n`tools/ablation.sh`, %s steps. ' "$steps"
printf 'Rendered objects, ADD below 5 and 10 %% of the diameter, median of the steps; no outline.\n\n'
printf '| network | small: < 5 %% | < 10 %% | steps | large: < 5 %% | < 10 %% | steps |\n'
printf '|---|---|---|---|---|---|---|\n'
measure "correlation, all six axes" "$output/correlation/$file" "$objects"
measure "correlation, single actions" "$output/correlation/$file" "$objects" --single_actions
measure "correlation without depth, all six axes" "$output/no_depth/$file" "$objects"
measure "paper, many objects, single actions" "$output/paper/$file" "$objects"
for name in "${singles[@]}"; do
    measure "paper, \`$name\` alone, on it" "$output/paper_$name/$file" "$output/mesh_$name"
    measure "correlation, many objects, on \`$name\`" "$output/correlation/$file" "$output/mesh_$name"
done
