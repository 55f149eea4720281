"""Compressed glTF."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.support.gltf_files import load
from tests.support.patches import BOX, all_right, textured_glb


def test_draco_is_decoded(tmp_path: Path) -> None:
    draco = pytest.importorskip("DracoPy", reason="pip install 'moveit6d[draco]'")
    down = np.stack([BOX.uv[:, 0], 1 - BOX.uv[:, 1]], -1)
    packed = draco.encode(
        BOX.vertices.astype(np.float32), BOX.faces.astype(np.uint32),
        tex_coord=down, quantization_bits=14, preserve_order=True,
    )  # fmt: skip
    numbers = {one["attribute_type"]: one["unique_id"] for one in draco.decode(packed).attributes}
    glb = textured_glb()
    glb.primitive["extensions"] = {
        "KHR_draco_mesh_compression": {
            "bufferView": glb.view(packed),
            "attributes": {"POSITION": numbers[0], "TEXCOORD_0": numbers[3]},
        }
    }
    glb.json["extensionsRequired"] = ["KHR_draco_mesh_compression"]
    assert all_right(load(glb, tmp_path))
