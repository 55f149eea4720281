"""Instances of one mesh: which poses are of the same one, and which meshes are the same.

Never sees an image.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch

from ...geometry.camera import Camera
from ...geometry.mesh import Mesh
from ...geometry.pose import Pose


def is_same_instance(mesh: Mesh, camera: Camera, one: Pose, other: Pose, share: float) -> bool:
    """Whether centred poses lie nearer than a share of the object's width in the image."""
    a, b = one.translation, other.translation
    aside = (camera.project(a) - camera.project(b)).norm()
    width = camera.fx * mesh.sphere_diameter / float(torch.minimum(a[2], b[2]))
    return float(aside) < share * width


def first_of_instances(
    mesh: Mesh, camera: Camera, centred: Sequence[Pose], share: float
) -> list[int]:
    """Indices of those centred poses, the best first, that are the first of their instance."""
    kept: list[int] = []
    for k, one in enumerate(centred):
        if not any(is_same_instance(mesh, camera, one, centred[known], share) for known in kept):
            kept.append(k)
    return kept


def same_meshes(meshes: Sequence[Mesh]) -> list[list[int]]:
    """Of each mesh the indices of the others that are the same one, under whatever names.

    Two boxes that differ in their print are two meshes.
    """
    return [
        [k for k, other in enumerate(meshes) if k != number and _is_same_mesh(mesh, other)]
        for number, mesh in enumerate(meshes)
    ]


def _is_same_mesh(one: Mesh, other: Mesh) -> bool:
    if one is other:
        return True
    arrays = ((getattr(mesh, name) for mesh in (one, other)) for name in _SHAPE_AND_COLOURS)
    return all(_are_equal(*pair) for pair in arrays)


def _are_equal(one: Any, other: Any) -> bool:
    if one is None or other is None:
        return one is other
    return np.array_equal(one, other)


_SHAPE_AND_COLOURS = ("center", "vertices", "faces", "uv", "texture", "vertex_colors")
