"""The GPU's rasteriser compiled by a C++ compiler, so that it is tested where there is no GPU."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from functools import lru_cache
from pathlib import Path
from tempfile import mkdtemp

import pytest
from torch import Tensor

from moveit6d.rendering.cuda_renderer import SOURCE, Run
from moveit6d.rendering.mesh_bank import MeshBank


@lru_cache(maxsize=1)
def compiled() -> Run:
    """Skips the test where there is no compiler."""
    compiler = shutil.which("c++") or shutil.which("g++")
    if compiler is None:
        pytest.skip("no C++ compiler")
    library = Path(mkdtemp()) / "rasterize.so"
    command = [compiler, "-x", "c++", "-O2", "-shared", "-fPIC", "-o", str(library), str(SOURCE)]
    subprocess.run(command, check=True)
    kernels = ctypes.CDLL(str(library))

    def run(
        bank: MeshBank,
        slots: Tensor,
        pose: Tensor,
        lens: Tensor,
        nearest: Tensor,
        albedo: Tensor,
        normal: Tensor,
        depth: Tensor,
        size: int,
    ) -> None:
        tensors = (
            bank.corners, bank.values, bank.places, bank.meta, bank.measures, bank.levels,
            bank.texels, slots, pose, lens, nearest, albedo, normal, depth,
        )  # fmt: skip
        pointers = [ctypes.c_void_p(tensor.data_ptr()) for tensor in tensors]
        kernels.run(*pointers, size, len(slots))

    return run
