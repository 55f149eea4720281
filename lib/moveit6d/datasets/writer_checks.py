"""What writers of data sets refuse: cameras that a format cannot hold, files that others share.

Never writes into the data set.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..geometry.camera import Camera
from ..geometry.mesh import Mesh
from ..geometry.symmetry import Symmetries
from ..geometry.symmetry_file import write_symmetries

CLOSE = 1e-5  # of the diameter: what is left of a place in a file of text or single precision
FileUnit = Literal["m", "mm"]
MeshWriter = Callable[[Path, Mesh, FileUnit], None]  # write_ply or write_obj


def check_no_lens(camera: Camera, what: str) -> None:
    """`InputError` for a camera with a lens, which `what`, a file or format, cannot hold."""
    if camera.lens is not None:
        raise InputError(
            f"{what} holds no lens distortion, and the camera has {camera.distortion_model} "
            "coefficients; undistort the images (Camera.undistort) and give the pinhole camera."
        )


def check_no_skew(camera: Camera, what: str) -> None:
    """`InputError` for a skewed camera, which `what`, a file or format, cannot hold."""
    if camera.skew:
        raise InputError(
            f"{what} holds no skew, and the camera has one of {camera.skew:g}; resample the images "
            "for a camera without it."
        )


def write_shared_mesh(path: Path, mesh: Mesh, write: MeshWriter, unit: FileUnit = "m") -> None:
    """Write a mesh and its symmetries, unless just these are there; `InputError` for others.

    Other sequences may show what is there.
    """
    if path.is_file():
        _check_same(path, mesh, write, unit)
        return
    write(path, mesh, unit)
    write_symmetries(path, mesh.symmetries)


def _check_same(path: Path, mesh: Mesh, write: MeshWriter, unit: FileUnit) -> None:
    there = Mesh.load(path, unit, allow_untextured=True, allow_flat=True)
    with TemporaryDirectory() as folder:
        # Files hold fewer digits, and readers may split vertices: both sides pass through a file.
        copy = Path(folder) / path.name
        write(copy, mesh, unit)
        write_symmetries(copy, mesh.symmetries)
        given = Mesh.load(copy, unit, allow_untextured=True, allow_flat=True)
    if not (_same_surface(there, mesh) or _same_surface(there, given)):
        what = "another mesh"
    elif not _same_symmetries(there.symmetries, given.symmetries):
        what = "a mesh with other symmetries"
    else:
        return
    raise InputError(
        f"{path} is there and holds {what} than the one given, which other sequences may show; "
        "give the object another name, or remove that file and write all its sequences again."
    )


def _same_surface(one: Mesh, other: Mesh) -> bool:
    if not np.array_equal(one.faces, other.faces) or len(one.vertices) != len(other.vertices):
        return False
    moved = one.vertices - other.vertices + (one.center - other.center)
    if np.abs(moved).max() > CLOSE * other.diameter:
        return False
    return (
        _close(one.uv, other.uv, 1e-5)
        and _close(one.texture, other.texture, 0)
        and _close(one.vertex_colors, other.vertex_colors, 0)
    )


def _same_symmetries(one: Symmetries, other: Symmetries) -> bool:
    """Whether both name the same motions and axes, in the same order."""
    if len(one.continuous) != len(other.continuous):
        return False
    axes = zip(one.continuous, other.continuous, strict=True)
    return _close(one.discrete, other.discrete, 1e-6) and all(
        _close(a.axis, b.axis, 1e-6) and _close(a.offset, b.offset, 1e-6) for a, b in axes
    )


def _close(one: NDArray[np.generic] | None, other: NDArray[np.generic] | None, by: float) -> bool:
    if one is None or other is None:
        return one is other
    return one.shape == other.shape and np.allclose(
        one.astype(np.float64), other.astype(np.float64), rtol=0, atol=by
    )
