"""An object from its six sides in one picture: what the library understood of a mesh.

Never knows files; light comes from the camera, as nothing else is known.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from ..geometry.mesh import Mesh
from ..geometry.pose import Pose
from ..rendering.renderer import Renderer

SIDE = 256  # pixels of each view
DISTANCE = 4.0  # of the camera, in sphere diameters
FILL = 0.9  # part of a view that the bounding sphere takes
# From where the camera looks, and what is up in the picture, in the file's axes.
VIEWS = (
    ("+x", (1, 0, 0), (0, 0, 1)),
    ("+y", (0, 1, 0), (0, 0, 1)),
    ("+z", (0, 0, 1), (0, 1, 0)),
    ("-x", (-1, 0, 0), (0, 0, 1)),
    ("-y", (0, -1, 0), (0, 0, 1)),
    ("-z", (0, 0, -1), (0, 1, 0)),
)
BACKGROUND = 0.93


def six_sides(mesh: Mesh, renderer: Renderer) -> NDArray[np.uint8]:
    """The mesh seen from +x, +y, +z and, below, from −x, −y, −z: RGB (512, 768, 3)."""
    rotations = np.stack([_towards(np.array(eye), np.array(up)) for _, eye, up in VIEWS])
    distance = DISTANCE * mesh.sphere_diameter
    place = torch.tensor([0.0, 0.0, distance], dtype=torch.float64).expand(len(VIEWS), 3)
    focal = FILL * SIDE * DISTANCE
    middle = (SIDE - 1) / 2
    matrix = [[focal, 0.0, middle], [0.0, focal, middle], [0.0, 0.0, 1.0]]
    seen = renderer.render(
        [mesh] * len(VIEWS),
        Pose(torch.from_numpy(rotations), place),
        torch.tensor([matrix] * len(VIEWS), dtype=torch.float64),
        SIDE,
    )
    light = 0.55 + 0.45 * (-seen.normal[:, 2:]).clamp(0, 1)
    shown = seen.albedo * light * seen.mask + BACKGROUND * (1 - seen.mask)
    tiles = np.rint(255 * shown.permute(0, 2, 3, 1).numpy()).astype(np.uint8)
    tiles = np.stack([_labelled(tile, VIEWS[k][0]) for k, tile in enumerate(tiles)])
    return np.concatenate([np.concatenate(tiles[:3], 1), np.concatenate(tiles[3:], 1)])


def _towards(eye: NDArray[np.int64], up: NDArray[np.int64]) -> NDArray[np.float64]:
    """The rotation (3, 3) of an object that is looked at from `eye`: x right, y down, z forward."""
    forward = -eye.astype(np.float64)
    right = np.cross(forward, up.astype(np.float64))
    return np.stack([right, np.cross(forward, right), forward])


def _labelled(tile: NDArray[np.uint8], text: str) -> NDArray[np.uint8]:
    import cv2

    tile = np.ascontiguousarray(tile)
    cv2.putText(tile, text, (8, 22), cv2.FONT_HERSHEY_SIMPLEX, 0.6, (60, 60, 60), 1, cv2.LINE_AA)
    return tile
