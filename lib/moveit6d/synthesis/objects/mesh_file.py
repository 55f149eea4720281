"""Writes a `Mesh` as a GLB file, in the frame and with the colours it was made with.

Never reads; `Mesh.load` does.
"""

from __future__ import annotations

from pathlib import Path

from PIL import Image

from ...datasets.mesh_writers import is_plain
from ...geometry.mesh import Mesh
from ...io import replacing


def write_glb(path: Path, mesh: Mesh) -> None:
    """One binary glTF file in metres; `Mesh.load(path, "m")` gives the same object back.

    A plain grey mesh gets no colours; one flat colour is written, and read with `allow_flat`.
    """
    import trimesh

    if mesh.texture is not None:
        material = trimesh.visual.material.PBRMaterial(
            baseColorTexture=Image.fromarray(mesh.texture), metallicFactor=0.0, doubleSided=True
        )
        visual = trimesh.visual.TextureVisuals(uv=mesh.uv, material=material)
    else:
        colors = None if is_plain(mesh) else mesh.vertex_colors
        visual = trimesh.visual.ColorVisuals(vertex_colors=colors)
    shape = trimesh.Trimesh(
        vertices=mesh.vertices + mesh.center, faces=mesh.faces, visual=visual, process=False
    )
    with replacing(path) as temporary:
        shape.export(temporary, file_type="glb")
