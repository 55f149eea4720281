"""Buffers of glTF: quantised, in other modes, cut off."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from moveit6d.errors import InputError
from moveit6d.geometry.mesh import Mesh
from tests.support.gltf_files import gltf_file, load
from tests.support.patches import BOX, Glb, all_right, textured_glb


@pytest.mark.parametrize("uri", ["my%20skin.png", "./My Skin.PNG", "textures\\my skin.png"])
def test_escaped_names(tmp_path: Path, uri: str) -> None:
    BOX.write_picture(tmp_path / "my skin.png")
    assert all_right(Mesh.load(gltf_file(tmp_path, uri)))


def test_quantised_positions_and_coordinates(tmp_path: Path) -> None:
    glb = textured_glb()
    scaled = np.rint(BOX.vertices / 0.05 * 32767).astype("<i2")
    glb.add("POSITION", np.concatenate([scaled, np.zeros((24, 1), "<i2")], 1)[:, :3].copy(), True)
    down = np.stack([BOX.uv[:, 0], 1 - BOX.uv[:, 1]], -1)
    glb.add("TEXCOORD_0", np.rint(down * 65535).astype("<u2"), True)
    glb.json["nodes"][0]["scale"] = [0.05] * 3
    glb.json["extensionsRequired"] = ["KHR_mesh_quantization"]
    assert all_right(load(glb, tmp_path))


def test_other_modes_of_triangles(tmp_path: Path) -> None:
    sheet = np.array([[0, 0, 0], [0, 1, 0], [1, 0, 0], [1, 1, 0], [2, 0, 0]], "<f4") / 10
    for mode, count, area in ((5, 3, 0.015), (6, 3, None)):
        glb = Glb()
        glb.add("POSITION", sheet)
        glb.primitive["mode"] = mode
        mesh = load(glb, tmp_path)
        assert len(mesh.faces) == count
        a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
        if area is not None:
            normals = np.cross(b - a, c - a)
            assert np.linalg.norm(normals, axis=1).sum() / 2 == pytest.approx(area)
            assert (normals[:, 2] < 0).all()


def test_a_file_that_was_cut_off_says_so(tmp_path: Path) -> None:
    textured_glb().write(tmp_path / "box.glb")
    whole = (tmp_path / "box.glb").read_bytes()
    for length in (30, len(whole) // 2, len(whole) - 3):
        (tmp_path / "box.glb").write_bytes(whole[:length])
        with pytest.raises(InputError, match="cut off"):
            Mesh.load(tmp_path / "box.glb")
