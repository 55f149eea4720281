"""glTF and GLB files on disk."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from moveit6d.geometry.mesh import Mesh
from tests.support.patches import Glb, textured_glb


def load(glb: Glb, folder: Path, **options: Any) -> Mesh:
    glb.write(folder / "box.glb")
    return Mesh.load(folder / "box.glb", **options)


def gltf_file(folder: Path, uri: str) -> Path:
    glb = textured_glb()
    glb.json["images"] = [{"uri": uri}]
    glb.json["buffers"] = [{"byteLength": len(glb.binary), "uri": "box%20data.bin"}]
    (folder / "box data.bin").write_bytes(glb.binary)
    (folder / "box.gltf").write_text("\ufeff" + json.dumps(glb.json), encoding="utf-8")
    return folder / "box.gltf"
