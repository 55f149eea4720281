"""Many meshes in a few tensors on one device, for renderers that draw large batches of them.

Never renders. Slots can be filled anew while training goes on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..geometry.mesh import Mesh
from .texture import MipMap

LEVELS = 12  # halvings of a texture at most
SPARE = 4  # a quarter more room where a bank grows, so that it seldom has to


@dataclass(frozen=True)
class PackedMesh:
    """What a slot of a `MeshBank` holds, as arrays: small enough to be sent between processes.

    `corners` (F, 9) and `values` (F, 18) as rendering/rasterize.cu wants them, `texels` (T, 3)
    uint8 of all levels one after another, `levels` (L, 3) first texel, height and width of each;
    `symmetries` (S, 4, 4) are motions of the centred frame, the identity first.
    """

    corners: NDArray[np.float32]
    values: NDArray[np.float32]
    texels: NDArray[np.uint8]
    levels: NDArray[np.int32]
    repeats: bool
    texels_per_metre: float
    sphere_diameter: float
    symmetries: NDArray[np.float64]


def pack_mesh(mesh: Mesh) -> PackedMesh:
    """A mesh as a slot holds it."""
    colour = mesh.uv if mesh.uv is not None else mesh.vertex_colors
    assert colour is not None
    faces = mesh.faces
    values = np.zeros((len(faces), 3, 6), np.float32)
    values[..., :3] = mesh.corner_normals
    values[..., 3 : 3 + colour.shape[1]] = colour[faces]
    texels, levels = np.zeros((0, 3), np.uint8), np.zeros((0, 3), np.int32)
    repeats, density = False, 0.0
    texture = None if mesh.texture is None else MipMap(mesh)
    if texture is not None:
        pictures = texture.levels[:LEVELS]
        sizes = [picture.shape[0] * picture.shape[1] for picture in pictures]
        first = np.cumsum([0, *sizes[:-1]])
        levels = np.array(
            [[start, *picture.shape[:2]] for start, picture in zip(first, pictures, strict=True)],
            np.int32,
        )
        texels = np.concatenate([picture.reshape(-1, 3) for picture in pictures])
        repeats, density = texture.wraps, texture.texels_per_metre
    return PackedMesh(
        mesh.vertices[faces].reshape(-1, 9).astype(np.float32),
        values.reshape(-1, 18),
        texels,
        levels,
        repeats,
        density,
        mesh.sphere_diameter,
        mesh.motions,
    )


class MeshBank:
    """`slots` meshes of any sizes, one behind the other, so that a large one costs no other's room.

    `faces` and `texels` (all levels of a texture) are how many there is room for at once; where
    more are put, it grows.
    """

    def __init__(self, slots: int, device: torch.device, faces: int = 0, texels: int = 0) -> None:
        self.device = device
        corners, values = (torch.zeros(faces, width, device=device) for width in (9, 18))
        self._faces = _Blocks(slots, [corners, values])
        self._texels = _Blocks(slots, [torch.zeros(texels, 3, dtype=torch.uint8, device=device)])
        self.places = torch.zeros(slots, 2, dtype=torch.int64, device=device)
        self.levels = torch.zeros(slots, LEVELS, 3, dtype=torch.int32, device=device)
        self.meta = torch.zeros(slots, 4, dtype=torch.int32, device=device)
        self.measures = torch.zeros(slots, 2, device=device)
        self.diameter = torch.ones(slots, dtype=torch.float64, device=device)
        self.symmetries: list[NDArray[np.float64]] = [np.eye(4)[None]] * slots

    @property
    def corners(self) -> Tensor:
        """Corners of all meshes' faces (F, 9)."""
        return self._faces.tensors[0]

    @property
    def values(self) -> Tensor:
        """Normals and colours at them (F, 18)."""
        return self._faces.tensors[1]

    @property
    def texels(self) -> Tensor:
        """Texels of all meshes' textures (T, 3)."""
        return self._texels.tensors[0]

    @property
    def most_faces(self) -> int:
        """Faces of the largest mesh."""
        return int(self._faces.used.max())

    def put(self, slot: int, mesh: PackedMesh) -> None:
        """Fill a slot, in place of what it held."""
        self._faces.put(slot, [mesh.corners, mesh.values])
        self._texels.put(slot, [mesh.texels])
        first = np.stack([self._faces.first, self._texels.first], 1)
        self.places = torch.from_numpy(first).to(self.device)  # others may have moved
        count, levels = len(mesh.corners), len(mesh.levels)
        if levels:
            self.levels[slot, :levels] = torch.from_numpy(mesh.levels).to(self.device)
        about = torch.tensor([count, levels, int(mesh.repeats), 0], dtype=torch.int32)
        self.meta[slot] = about.to(self.device)
        measures = torch.tensor([mesh.texels_per_metre, 0.5 * mesh.sphere_diameter])
        self.measures[slot] = measures.to(self.device)
        self.diameter[slot] = mesh.sphere_diameter
        self.symmetries[slot] = mesh.symmetries

    @staticmethod
    def of(meshes: Sequence[PackedMesh], device: torch.device) -> MeshBank:
        """A bank with just the room for some meshes, which are in its slots."""
        faces = sum(len(mesh.corners) for mesh in meshes)
        bank = MeshBank(len(meshes), device, faces, sum(len(mesh.texels) for mesh in meshes))
        for slot, mesh in enumerate(meshes):
            bank.put(slot, mesh)
        return bank


class _Blocks:
    """Rows of some tensors, a block of them for each slot.

    `first` are the blocks' first rows, `used` how many of their rows are in use.
    """

    def __init__(self, slots: int, tensors: Sequence[Tensor]) -> None:
        self.tensors = list(tensors)
        self.first, self.used, self._size = np.zeros((3, slots), np.int64)
        self._end = 0  # of the last block

    def put(self, slot: int, arrays: Sequence[NDArray[Any]]) -> None:
        """Rows (N, …) for each tensor, in place of the slot's."""
        count = len(arrays[0])
        self.used[slot] = 0
        if count > self._size[slot]:
            self._size[slot] = 0
            if self._end + count > len(self.tensors[0]):
                self._move_together(count)
            self.first[slot], self._size[slot] = self._end, count
            self._end += count
        rows = slice(self.first[slot], self.first[slot] + count)
        for tensor, array in zip(self.tensors, arrays, strict=True):
            tensor[rows] = torch.from_numpy(array).to(tensor.device)
        self.used[slot] = count

    def _move_together(self, more: int) -> None:
        """Close the gaps between the blocks, and grow where that leaves no room for `more` rows."""
        first, live = np.cumsum(self.used) - self.used, int(self.used.sum())
        room = len(self.tensors[0])
        if live + more > room:
            room = live + more + live // SPARE
        for number, old in enumerate(self.tensors):
            new = old.new_zeros(room, *old.shape[1:])
            for start, end, count in zip(self.first, first, self.used, strict=True):
                new[end : end + count] = old[start : start + count]
            self.tensors[number] = new
        self.first, self._size, self._end = first, self.used.copy(), live
