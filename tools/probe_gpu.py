"""Before a training on a GPU: does it draw what rays see, and how long does each part take?

Run by `train_on_gpu.sh probe`, in the folder that `pack_for_gpu.py` packed.
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import get_args

import numpy as np
import torch
from PIL import Image
from torch import Tensor

from lightning_modules.bank_pairs import BankStream
from lightning_modules.cli import read_data
from lightning_modules.pose_action_module import PoseActionModule
from moveit6d.geometry.crop import look_at
from moveit6d.geometry.mesh import Mesh, Unit
from moveit6d.geometry.pose import Pose
from moveit6d.networks.compact import CompactCorrelationNet
from moveit6d.observation import Observation
from moveit6d.rendering.cuda_renderer import BankRenderer
from moveit6d.rendering.mesh_bank import MeshBank, pack_mesh
from moveit6d.synthesis.training.contact_sheet import contact_sheet
from moveit6d.synthesis.training.pairs import TrainingBatch

CUDA = torch.device("cuda")
BATCHES = 24
PAIRS = 12  # in a picture, about


def main(folder: Path, output: Path) -> None:
    """Compare, time, and keep pictures of a few pairs."""
    print(f"torch {torch.__version__}, {torch.cuda.get_device_name(0)}", flush=True)
    _compare(folder)
    module = PoseActionModule(CompactCorrelationNet()).to(CUDA)

    def student(observation: Observation) -> Tensor:
        with torch.no_grad(), torch.autocast("cuda", torch.bfloat16):
            delta: Tensor = module.network(observation).prediction.delta
        return delta.float()

    configs = folder / "code/configs"
    data = read_data(
        [
            f"--config={configs / 'fit/compact.yaml'}",
            f"--config={configs / 'overlay/gpu_pairs.yaml'}",
            f"--data.meshes={folder / 'meshes'}",
            f"--data.mesh_unit={_unit(folder)}",
            f"--data.photos={folder / 'photos'}",
            "--data.shapes=160",
        ]
    )
    begin = time.perf_counter()
    stream = iter(BankStream(data.source(), data.batch_size, (0, 0, 0), CUDA, 2, student))
    batch = next(stream)
    _picture(batch, output / "new.png")
    print(f"objects and first batch {time.perf_counter() - begin:.1f} s", flush=True)
    _time(stream, batch, module)
    _picture(next(stream), output / "later.png")
    print(f"peak memory {torch.cuda.max_memory_allocated() / 1e9:.1f} GB", flush=True)


def _unit(folder: Path) -> Unit:
    """Of the pack's meshes."""
    said, units = (folder / "mesh_unit").read_text(encoding="utf-8"), get_args(Unit)
    found: Unit = units[units.index(said)]
    return found


def _compare(folder: Path) -> None:
    """Renderings of the GPU beside those by ray casting."""
    wanted = np.load(folder / "reference.npz")
    paths = [folder / "meshes" / str(name) for name in wanted["names"]]
    unit = _unit(folder)
    meshes = [pack_mesh(Mesh.load(path, unit=unit, allow_flat=True)) for path in paths]
    bank = MeshBank.of(meshes, CUDA)
    rotation, translation = (
        torch.from_numpy(wanted[k]).to(CUDA) for k in ("rotation", "translation")
    )
    pose = Pose(rotation, translation)
    slots = torch.arange(len(meshes), device=CUDA)
    found = BankRenderer(bank).render(slots, pose, look_at(pose, bank.diameter).intrinsics)
    depth = torch.from_numpy(wanted["depth"]).to(CUDA)
    mask = (depth > 0).float()
    both = mask * found.mask
    outline = float((mask - found.mask).abs().sum() / mask.sum())
    deep = float(((depth - found.depth).abs() * both).max())
    albedo = torch.from_numpy(wanted["albedo"]).to(CUDA).float()
    colour = float(((albedo - found.albedo).abs() * both).sum() / both.sum() / 3)
    verdict = "as ray casting" if outline < 0.003 and deep < 1e-3 and colour < 0.01 else "WRONG"
    print(
        f"renderings {verdict}: outline {outline:.4f} of the area, depth within {deep:.1e} m, "
        f"colours {colour:.4f}",
        flush=True,
    )


def _time(stream: Iterator[TrainingBatch], batch: TrainingBatch, module: PoseActionModule) -> None:
    """Medians of drawing and of training, for new pictures and for later states."""
    optimizer = torch.optim.AdamW(module.network.parameters(), 1e-3)
    torch.backends.cudnn.benchmark = True
    spent: dict[str, list[float]] = {}
    for _ in range(BATCHES):
        kind = "new" if batch.views is not None else "later"
        torch.cuda.synchronize()
        begin = time.perf_counter()
        with torch.autocast("cuda", torch.bfloat16):
            loss, _ = module._shared_step(batch)
        optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        optimizer.step()
        torch.cuda.synchronize()
        spent.setdefault(f"train on {kind}", []).append(time.perf_counter() - begin)
        begin = time.perf_counter()
        batch = next(stream)
        torch.cuda.synchronize()
        kind = "new" if batch.views is not None else "later"
        spent.setdefault(f"draw {kind}", []).append(time.perf_counter() - begin)
    for name, times in sorted(spent.items()):
        middle, most = (1e3 * f(times[1:]) for f in (statistics.median, max))
        print(f"{name}: median {middle:.1f} ms a batch, {most:.1f} at most", flush=True)


def _picture(batch: TrainingBatch, path: Path) -> None:
    """A contact sheet of a few pairs."""
    few = next(batch.parts(len(batch.mesh) // PAIRS)).to(torch.device("cpu"))
    Image.fromarray(contact_sheet(few)).save(path)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
