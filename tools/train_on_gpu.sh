#!/usr/bin/env bash
# Train the compact network on a lent GPU, from what tools/pack_for_gpu.py packed.
#
#   bash train_on_gpu.sh probe            a minute: are the renderings right, how fast is each part
#   bash train_on_gpu.sh MINUTES [args]   train that long; further arguments go to `moveit6d fit`
#
# Weights, checkpoint and log come out in $OUT (./out without it). A `last.ckpt` that is put there
# first is resumed from, so that several short leases make one fit. In the last of them, pass
# `--model.minutes MINUTES`: the rest of the schedule ends in that time, however fast the machine is.
# Leave a minute of a lease for what comes before the first step and after the last one. Needs
# PyTorch with CUDA, CuPy and Lightning; wheels/ brings the rest.
set -euo pipefail
if (($# < 1)); then
    sed -n '2,12s/^# \{0,1\}//p' "$0"
    exit 2
fi
here=$(cd "$(dirname "$0")" && pwd)
out=${OUT:-$here/out}
if compgen -G "$here/wheels/*.whl" >/dev/null; then
    python3 -m pip install -q --no-index --no-deps --no-compile --no-cache-dir --upgrade \
        --target /tmp/moveit6d-site "$here"/wheels/*.whl
fi
export PYTHONPATH=$here/code/lib:$here/code:/tmp/moveit6d-site PYTHONUNBUFFERED=1 OMP_NUM_THREADS=1
mkdir -p "$out"
if [[ $1 == probe ]]; then
    exec python3 -W ignore "$here/probe_gpu.py" "$here" "$out"
fi
minutes=$1 unit=$(<"$here/mesh_unit")
shift
limit=$(python3 - "$minutes" "$out" <<'PYTHON'
import sys
from datetime import timedelta
from pathlib import Path
from pickle import UnpicklingError

import torch

limit = timedelta(minutes=float(sys.argv[1]))
checkpoints = sorted(Path(sys.argv[2]).glob("last*.ckpt"), key=lambda path: path.stat().st_mtime)
if checkpoints:  # the fit resumes from the newest, and Lightning counts the time before it, too
    try:
        known = torch.load(checkpoints[-1], map_location="cpu", weights_only=False)["callbacks"]
    except (RuntimeError, EOFError, UnpicklingError, KeyError):
        sys.exit(f"{checkpoints[-1]} is damaged: remove it, or put the one of an earlier lease there.")
    limit += timedelta(seconds=known.get("Timer", {}).get("time_elapsed", {}).get("train", 0))
seconds = int(limit.total_seconds()) + 2
print(f"00:{seconds // 3600:02d}:{seconds % 3600 // 60:02d}:{seconds % 60:02d}")
PYTHON
)
cat >/tmp/moveit6d-fit.py <<'PYTHON'
import sys

from lightning_modules.cli import main

if __name__ == "__main__":  # worker processes import this file
    main(sys.argv[1:])
PYTHON
python3 -W ignore /tmp/moveit6d-fit.py --config "$here/code/configs/fit/compact.yaml" \
    --config "$here/code/configs/overlay/gpu_pairs.yaml" \
    --data.meshes "$here/meshes" --data.mesh_unit "$unit" --data.photos "$here/photos" --output "$out" \
    --trainer.logger false --trainer.limit_val_batches 0 --trainer.max_time "$limit" \
    --model.teacher "$here/code/examples/correlation/multi_object.safetensors" \
    --checkpoint.every_n_train_steps 250 --export.every_n_steps 250 "$@" 2>&1 | tee -a "$out/log.txt"
