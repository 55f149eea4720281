"""Pictures of a mesh at a known pose before a mottled background; used by the tests only."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from torch import Tensor

from moveit6d.datasets.sequences import Sequence
from moveit6d.geometry.camera import Camera
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.rendering import make_renderer
from moveit6d.synthesis.objects.mesh_file import write_glb

CAMERA = Camera(300.0, 300.0, 127.5, 127.5, 256, 256)
FINER = 3  # rays a pixel and axis


def picture(mesh: Mesh, pose: Pose, background: NDArray[np.uint8] | None = None) -> Tensor:
    """The mesh at a centred pose (3, 256, 256), uint8, before a mottled grey-green background."""
    size = CAMERA.width * FINER
    intrinsics = CAMERA.resize(size, size).matrix
    buffer = make_renderer().render(
        [mesh], Pose(pose.rotation[None], pose.translation[None]), intrinsics[None], size
    )
    behind = mottled(0) if background is None else background
    layer = torch.cat([buffer.albedo * buffer.mask, buffer.mask], 1)
    coarse = torch.nn.functional.avg_pool2d(layer, FINER)[0]
    mixed = coarse[:3] + (1 - coarse[3:]) * torch.from_numpy(behind).permute(2, 0, 1) / 255
    return (mixed * 255).round().to(torch.uint8)


def one_frame(folder: Path, mesh: Mesh, seen: Pose, stated: Pose) -> Sequence:
    """A sequence of one picture of the mesh at a centred pose, with another one said to be true."""
    frames, file, truth = folder / "frames", folder / "mesh.glb", mesh.outer(stated)
    frames.mkdir()
    Image.fromarray(picture(mesh, seen).permute(1, 2, 0).numpy()).save(frames / "0.png")
    write_glb(file, mesh)
    return Sequence("one", folder, file, frames, CAMERA, truth, 0, {0: truth})


def mottled(seed: int, colour: tuple[int, int, int] = (90, 105, 80)) -> NDArray[np.uint8]:
    """Patches of noise (256, 256, 3) about a colour."""
    random = np.random.default_rng(seed)
    noise = random.normal(0, 12, (32, 32, 3)).repeat(8, 0).repeat(8, 1)
    return (np.array(colour) + noise).clip(0, 255).astype(np.uint8)
