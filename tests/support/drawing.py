"""Renderings of one mesh by embree."""

from __future__ import annotations

import numpy as np

from moveit6d.rendering.backends import make_renderer
from tests.support import meshes

RENDERER = make_renderer("embree")


def draw(mesh, seed=None, size=128, **kwargs):
    """The G-buffer of one mesh as arrays: albedo, normal (H, W, 3), depth, mask (H, W)."""
    pose, intrinsics = meshes.view(mesh, seed, size=size, **kwargs)
    return arrays(RENDERER.render([mesh], pose, intrinsics, size))


def arrays(buffer):
    albedo, normal = (x[0].permute(1, 2, 0).numpy() for x in (buffer.albedo, buffer.normal))
    return albedo, normal, buffer.depth[0, 0].numpy(), buffer.mask[0, 0].numpy()


def checkerboard(squares=8, texels=8):
    """Random colours, one a square: (texture, colours (squares, squares, 3))."""
    colors = np.random.default_rng(0).integers(0, 255, (squares, squares, 3), dtype=np.uint8)
    return colors.repeat(texels, 0).repeat(texels, 1), colors
