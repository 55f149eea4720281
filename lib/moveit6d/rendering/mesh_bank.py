"""Many meshes as padded tensors on one device, for renderers that draw large batches of them.

Never renders. Slots can be filled anew while training goes on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from ..errors import InputError
from ..geometry.mesh import Mesh
from .texture import MipMap

LEVELS = 12  # halvings of a texture at most


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
    """`slots` meshes of at most `faces` faces and `texels` texels (all levels of a texture)."""

    def __init__(self, slots: int, faces: int, texels: int, device: torch.device) -> None:
        self.faces, self.texel_capacity, self.device = faces, texels, device
        self.corners = torch.zeros(slots, faces, 9, device=device)
        self.values = torch.zeros(slots, faces, 18, device=device)
        self.texels = torch.zeros(slots, texels, 3, dtype=torch.uint8, device=device)
        self.levels = torch.zeros(slots, LEVELS, 3, dtype=torch.int32, device=device)
        self.meta = torch.zeros(slots, 4, dtype=torch.int32, device=device)
        self.measures = torch.zeros(slots, 2, device=device)
        self.diameter = torch.ones(slots, dtype=torch.float64, device=device)
        self.symmetries: list[NDArray[np.float64]] = [np.eye(4)[None]] * slots

    def fits(self, mesh: PackedMesh) -> bool:
        """Whether a slot is large enough for it."""
        return len(mesh.corners) <= self.faces and len(mesh.texels) <= self.texel_capacity

    def put(self, slot: int, mesh: PackedMesh) -> None:
        """Fill a slot; `InputError` if it is too small."""
        if not self.fits(mesh):
            raise InputError(
                f"A mesh of {len(mesh.corners)} faces and {len(mesh.texels)} texels does not fit a "
                f"slot for {self.faces} and {self.texel_capacity}."
            )
        count, texels, levels = len(mesh.corners), len(mesh.texels), len(mesh.levels)
        self.corners[slot, :count] = torch.from_numpy(mesh.corners).to(self.device)
        self.values[slot, :count] = torch.from_numpy(mesh.values).to(self.device)
        if levels:
            self.texels[slot, :texels] = torch.from_numpy(mesh.texels).to(self.device)
            self.levels[slot, :levels] = torch.from_numpy(mesh.levels).to(self.device)
        about = torch.tensor([count, levels, int(mesh.repeats), 0], dtype=torch.int32)
        self.meta[slot] = about.to(self.device)
        measures = torch.tensor([mesh.texels_per_metre, 0.5 * mesh.sphere_diameter])
        self.measures[slot] = measures.to(self.device)
        self.diameter[slot] = mesh.sphere_diameter
        self.symmetries[slot] = mesh.symmetries

    @staticmethod
    def of(meshes: Sequence[PackedMesh], device: torch.device, spare: int = 0) -> MeshBank:
        """A bank just large enough for some meshes, and `spare` slots more of the same size."""
        faces = max(len(mesh.corners) for mesh in meshes)
        texels = max(1, *(len(mesh.texels) for mesh in meshes))
        bank = MeshBank(len(meshes) + spare, faces, texels, device)
        for slot, mesh in enumerate(meshes):
            bank.put(slot, mesh)
        return bank
