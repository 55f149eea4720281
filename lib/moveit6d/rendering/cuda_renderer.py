"""Rasterising a whole batch of patches at once on a GPU: what training there draws its pairs with.

Never shades. It needs CuPy to compile `rasterize.cu`, which a machine without a GPU never does.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from ..errors import RenderingUnavailable
from ..geometry.crop import PATCH_SIZE
from ..geometry.pose import Pose
from .mesh_bank import MeshBank
from .renderer import GBuffer

SOURCE = Path(__file__).with_name("rasterize.cu")
THREADS = 128

Run = Callable[[MeshBank, Tensor, Tensor, Tensor, Tensor, Tensor, Tensor, Tensor, int], None]


class BankRenderer:
    """Draws slots of a `MeshBank`, one a patch."""

    def __init__(self, bank: MeshBank, run: Run | None = None) -> None:
        self.bank, self._run = bank, run or _gpu_kernels()

    def render(
        self, slots: Tensor, poses: Pose, intrinsics: Tensor, size: int = PATCH_SIZE
    ) -> GBuffer:
        """A patch of size × size for each slot (B,), as `Renderer.render` does for meshes."""
        device, batch = self.bank.device, len(slots)
        pose = torch.cat([poses.rotation.flatten(1), poses.translation], 1).float().contiguous()
        lens = torch.stack(
            [intrinsics[:, 0, 0], intrinsics[:, 1, 1], intrinsics[:, 0, 2], intrinsics[:, 1, 2]], 1
        )
        lens = lens.float().contiguous()
        nearest = torch.full((batch, size, size), -1, dtype=torch.int64, device=device)
        albedo, normal = torch.zeros(2, batch, 3, size, size, device=device)
        depth = torch.zeros(batch, 1, size, size, device=device)
        self._run(self.bank, slots.contiguous(), pose, lens, nearest, albedo, normal, depth, size)
        return GBuffer(albedo, normal, depth, (depth > 0).float())


def _gpu_kernels() -> Run:
    """The two kernels as one function."""
    try:
        import cupy
    except ImportError as error:
        raise RenderingUnavailable(
            f"Rendering on a GPU needs CuPy: pip install cupy-cuda13x or -cuda12x ({error})."
        ) from error
    module = cupy.RawModule(code=SOURCE.read_text(), options=("--std=c++14",))
    rasterize, resolve = module.get_function("rasterize"), module.get_function("resolve")

    def run(
        bank: MeshBank, slots: Tensor, pose: Tensor, lens: Tensor, nearest: Tensor,
        albedo: Tensor, normal: Tensor, depth: Tensor, size: int,
    ) -> None:  # fmt: skip
        batch, pixels = len(slots), size * size
        here = torch.cuda.current_stream().cuda_stream  # 0: the default one, CuPy's as well
        with cupy.cuda.ExternalStream(here) if here else nullcontext():
            rasterize(
                (-(-bank.most_faces // THREADS), batch), (THREADS,),
                _pointers(cupy, bank.corners, bank.places, bank.meta, slots, pose, lens, nearest)
                + (cupy.int32(size),),
            )  # fmt: skip
            resolve(
                (-(-pixels // THREADS), batch), (THREADS,),
                _pointers(
                    cupy, bank.corners, bank.values, bank.places, bank.meta, bank.measures,
                    bank.levels, bank.texels, slots, pose, lens, nearest, albedo, normal, depth,
                )
                + (cupy.int32(size),),
            )  # fmt: skip

    return run


def _pointers(cupy: Any, *tensors: Tensor) -> tuple[Any, ...]:
    return tuple(cupy.uint64(tensor.data_ptr()) for tensor in tensors)
