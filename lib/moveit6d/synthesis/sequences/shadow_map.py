"""A shadow map: where an object shades itself from a light far away.

Never shades; it answers how much of the light reaches each pixel.
"""

from __future__ import annotations

import torch
from torch import Tensor

from ...geometry.mesh import Mesh
from ...geometry.pose import Pose
from ...rendering.renderer import Renderer
from ..imaging.shading import ShadedSurface

SIZE = 160  # pixels of the depth image seen from the light
FAR = 6.0  # of the object's diameter: distance of that view
BIAS = 0.02  # of the diameter, by which a surface must be farther to be shaded
SAMPLES = ((-0.7, -0.3), (0.3, -0.7), (0.7, 0.3), (-0.3, 0.7))  # pixels: edges become soft


def light_visibility(
    renderer: Renderer, mesh: Mesh, pose: Pose, towards: Tensor, surface: ShadedSurface
) -> Tensor:
    """How much of the light from the direction `towards` (3,) reaches each pixel (N,): 0 to 1.

    The depth seen from the light at one centred `pose` (unbatched) is compared with each pixel's
    point of the `surface`, in metres, which may show the object at several near poses.
    """
    far = FAR * mesh.sphere_diameter
    forward = -towards.double()
    side = torch.linalg.cross(forward, torch.eye(3, dtype=torch.float64)[forward.abs().argmin()])
    side = side / side.norm()
    rotation = torch.stack([side, torch.linalg.cross(forward, side), forward])  # camera → light
    focal = SIZE / 1.1 * far / mesh.sphere_diameter
    middle = (SIZE - 1) / 2
    view = torch.tensor([[focal, 0, middle], [0, focal, middle], [0, 0, 1]], dtype=torch.float64)
    ahead = torch.tensor([[0, 0, far]], dtype=torch.float64)
    seen = renderer.render([mesh], Pose((rotation @ pose.rotation)[None], ahead), view[None], SIZE)
    nearest = torch.where(seen.depth > 0, seen.depth, torch.full_like(seen.depth, 1e9))
    point = surface.point @ rotation.float().T + ahead.float()
    pixel = point[:, :2] / point[:, 2:] * focal + middle
    grid = (pixel * 2 + 1) / SIZE - 1  # half-pixel rule
    lit = torch.zeros(len(point))
    for offset in SAMPLES:
        moved = (grid + torch.tensor(offset) * 2 / SIZE)[None, None]
        depth = torch.nn.functional.grid_sample(nearest, moved, "nearest", align_corners=False)
        behind = point[:, 2] >= depth[0, 0, 0] + BIAS * mesh.sphere_diameter
        lit += (~behind).float() / len(SAMPLES)
    return lit
