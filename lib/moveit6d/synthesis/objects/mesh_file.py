"""Writes a `Mesh` as a GLB file, in the frame and with the colours it was made with.

Never reads; `Mesh.load` does.
"""

from __future__ import annotations

from pathlib import Path

from PIL import Image

from ...geometry.mesh import Mesh
from ...io import replacing


def write_glb(path: Path, mesh: Mesh) -> None:
    """One binary glTF file in metres; `Mesh.load(path, "m")` gives the same object back."""
    import trimesh

    if mesh.texture is not None:
        material = trimesh.visual.material.PBRMaterial(
            baseColorTexture=Image.fromarray(mesh.texture), metallicFactor=0.0, doubleSided=True
        )
        visual = trimesh.visual.TextureVisuals(uv=mesh.uv, material=material)
    else:
        visual = trimesh.visual.ColorVisuals(vertex_colors=mesh.vertex_colors)
    shape = trimesh.Trimesh(
        vertices=mesh.vertices + mesh.center, faces=mesh.faces, visual=visual, process=False
    )
    with replacing(path) as temporary:
        shape.export(temporary, file_type="glb")
