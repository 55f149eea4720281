"""Compressed glTF."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from moveit6d.errors import InputError
from tests.support.gltf_files import load
from tests.support.patches import BOX, Glb, all_right, textured_glb


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


def packed_with_meshopt(name: str) -> Glb:
    """The textured box whose vertices and faces lie in compressed views, as gltfpack writes them.

    What the views unfold to has a buffer of its own, which has no data.
    """
    meshopt = pytest.importorskip("meshopt", reason="pip install 'moveit6d[meshopt]'")
    glb, version = textured_glb(), 1 if name.startswith("KHR") else 0
    down = np.stack([BOX.uv[:, 0], 1 - BOX.uv[:, 1]], -1).astype("<f4")
    positions = BOX.vertices.astype("<f4")
    faces = BOX.faces.reshape(-1).astype("<u4")
    for view, values, mode in (
        (0, positions, "ATTRIBUTES"), (1, down, "ATTRIBUTES"), (2, faces, "TRIANGLES"),
    ):  # fmt: skip
        packed = meshopt.encode_gltf_buffer(values, mode, version)
        place = glb.json["bufferViews"][glb.view(packed)]
        stride = values.itemsize * (1 if values.ndim == 1 else values.shape[1])
        glb.json["bufferViews"][view] = {
            "buffer": 1, "byteOffset": 0, "byteLength": values.nbytes,
            "extensions": {name: {**place, "byteStride": stride, "count": len(values),
                                  "mode": mode}},
        }  # fmt: skip
    glb.json["extensionsRequired"] = [name]
    return glb


@pytest.mark.parametrize("name", ["EXT_meshopt_compression", "KHR_meshopt_compression"])
def test_meshopt_is_decoded(tmp_path: Path, name: str) -> None:
    assert all_right(load(packed_with_meshopt(name), tmp_path))


def test_what_meshopt_filters_is_unfiltered(tmp_path: Path) -> None:
    meshopt = pytest.importorskip("meshopt", reason="pip install 'moveit6d[meshopt]'")
    glb = packed_with_meshopt("EXT_meshopt_compression")
    rough = meshopt.encode_filter_exp(BOX.vertices.astype("<f4"), 12)
    place = glb.json["bufferViews"][glb.view(meshopt.encode_gltf_buffer(rough, "ATTRIBUTES"))]
    glb.json["bufferViews"][0]["extensions"]["EXT_meshopt_compression"].update(
        place, filter="EXPONENTIAL"
    )
    assert all_right(load(glb, tmp_path))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"count": 10**9}, "cannot hold 1000000000 rows"),
        ({"count": -3}, "cannot hold -3 rows"),
        ({"count": 23}, "beyond its data|damaged"),
        ({"byteStride": 13}, "damaged"),
        ({"mode": "OTHER"}, "damaged"),
        ({"filter": "OTHER"}, "damaged"),
        ({"byteLength": 10}, "damaged"),
        ({"byteLength": 10**6}, "cut off or damaged"),
        ({"buffer": 7}, "cannot be read as a mesh"),
    ],
)
def test_damaged_meshopt_data_is_one_sentence(
    tmp_path: Path, change: dict[str, Any], words: str
) -> None:
    glb = packed_with_meshopt("EXT_meshopt_compression")
    glb.json["bufferViews"][0]["extensions"]["EXT_meshopt_compression"].update(change)
    with pytest.raises(InputError, match=words) as error:
        load(glb, tmp_path)
    assert len(str(error.value)) < 400 and "\n" not in str(error.value)


def test_meshopt_without_its_package_is_refused_by_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    glb = packed_with_meshopt("EXT_meshopt_compression")
    monkeypatch.setitem(sys.modules, "meshopt", None)
    with pytest.raises(InputError, match=r"compressed with meshopt; pip install 'moveit6d\["):
        load(glb, tmp_path)
