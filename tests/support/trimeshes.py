"""Meshes of trimesh with colours, to be written to files."""

from __future__ import annotations

import numpy as np
import trimesh
from PIL import Image

from tests.support import meshes

TEXTURE = np.random.default_rng(0).integers(0, 255, (16, 8, 3), dtype=np.uint8)


def textured(texture=TEXTURE, extents=(0.1, 0.06, 0.04), shift=(0, 0, 0)) -> trimesh.Trimesh:
    vertices, faces, uv, _ = meshes.box_arrays(extents)
    visual = trimesh.visual.TextureVisuals(uv=uv, image=Image.fromarray(texture))
    return trimesh.Trimesh(vertices + np.array(shift), faces, visual=visual, process=False)


def colored() -> trimesh.Trimesh:
    vertices, faces, _, colors = meshes.box_arrays()
    return trimesh.Trimesh(vertices, faces, vertex_colors=colors, process=False)
