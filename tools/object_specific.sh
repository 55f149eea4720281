#!/usr/bin/env bash
# The paper's network trained for one object, and the shipped model on the same object.
#
#   tools/object_specific.sh MESH OCCLUDERS PHOTOS BACKGROUNDS OUTPUT [STEPS [RATE]]
#
# MESH is one file; its pictures are in front of PHOTOS with OCCLUDERS (a folder of meshes) before
# them, and it is measured in front of BACKGROUNDS, which are other pictures. The paper's pairs
# (configs/pairs/paper.yaml), 51,200 of them written first: what training reads again and again.
# The paper's 25,000 steps by default: two hours of one core. A killed run goes on.
set -euo pipefail
if (($# < 5)); then
    sed -n '2,9s/^# \{0,1\}//p' "$0"
    exit 2
fi
cd "$(dirname "${BASH_SOURCE[0]}")/.."
mesh=$1 occluders=$2 photos=$3 backgrounds=$4 output=$5 steps=${6:-25000} rate=${7:-4.0e-4}
config=configs/fit/object_specific.yaml

moveit6d() { .venv/bin/moveit6d "$@"; }

measure() { # NAME CLUSTER [OPTION …]
    local name=$1 cluster=$2
    shift 2
    moveit6d benchmark refinement --objects "$output/mesh" --photos "$backgrounds" --cluster "$cluster" \
        --gamma 1 --no_contour --threads 1 --number 100 "$@" |
        awk -v name="$name | $cluster" '/^after/ { five = $3; ten = $4 } /^iterations/ { median = $NF }
             END { print "| " name " | " five " | " ten " | " median " |" }'
}

mkdir -p "$output/mesh"
cp "${mesh%.*}".* "$output/mesh"
moveit6d write-pairs --config $config --set data.meshes="$output/mesh" \
    --set data.occluders="$occluders" --set data.photos="$photos" --output "$output/pairs" \
    --shards 80 --batches 20 --seed 0 >&2
moveit6d fit --config $config --threads 1 --data.written "$output/pairs" --data.workers 0 \
    --trainer.precision bf16-mixed --model.learning_rate "$rate" --model.schedule cosine --model.warmup_steps 100 \
    --model.total_steps "$steps" --trainer.max_steps "$steps" --trainer.limit_val_batches 0 \
    --trainer.logger false --trainer.accelerator cpu --output "$output" >&2

printf '| network | starts | < 5 %% | < 10 %% | median steps |\n|---|---|---|---|---|\n'
long=(--max_iterations 150) # single actions from far away need more than the usual 30
for cluster in one_large all_small all_large; do
    measure "the paper's, this object alone" $cluster "${long[@]}" \
        --weights "$output/weights.safetensors"
    measure "shipped, single actions" $cluster "${long[@]}" --mode single
    measure "shipped, all six axes" $cluster
done
