"""glTF and GLB: what the file says of its looks and its shape is shown, or refused by name."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from moveit6d.errors import InputError
from moveit6d.geometry.mesh import Mesh
from tests.support.gltf_files import gltf_file, load
from tests.support.patches import BOX, textured_glb


def test_a_missing_picture_is_named(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = gltf_file(tmp_path, "gone.png")
    with pytest.raises(InputError, match=r"material 'skin'.*gone.png.*not there"):
        Mesh.load(path)
    Mesh.load(path, allow_untextured=True)
    assert "gone.png" in caplog.text


def test_nodes_scenes_and_mirrors(tmp_path: Path) -> None:
    glb = textured_glb()
    glb.json["nodes"] = [
        {"children": [1], "translation": [0.1, 0.2, 0.3], "rotation": [0, 0, 0.6, 0.8]},
        {"mesh": 0, "matrix": [2, 0, 0, 0, 0, -3, 0, 0, 0, 0, 4, 0, 0.1, 0, 0, 1]},
        {"mesh": 0, "translation": [9, 9, 9]},  # in no scene
    ]
    mesh = load(glb, tmp_path)
    local = BOX.vertices * (2, -3, 4) + (0.1, 0, 0)
    turned = local @ np.array([[0.28, -0.96, 0], [0.96, 0.28, 0], [0, 0, 1]]).T + (0.1, 0.2, 0.3)
    np.testing.assert_allclose(mesh.vertices + mesh.center, turned, atol=1e-6)
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    assert ((np.cross(b - a, c - a) * (a + b + c)).sum(1) > 0).all()  # faces still look outwards


def test_hidden_nodes_are_no_part_of_the_object(tmp_path: Path) -> None:
    def visible(value: bool) -> dict[str, Any]:
        return {"extensions": {"KHR_node_visibility": {"visible": value}}}

    glb = textured_glb()
    glb.json["extensionsUsed"] = glb.json["extensionsRequired"] = ["KHR_node_visibility"]
    far = {"mesh": 0, "translation": [9, 9, 9]}
    glb.json["nodes"] = [
        {"mesh": 0, **visible(True)},
        {**far, **visible(False), "children": [2]},
        {**far, **visible(True), "children": [3]},  # hidden by what it hangs below
        far,
    ]
    glb.json["scenes"] = [{"nodes": [0, 1]}]
    mesh = load(glb, tmp_path)
    np.testing.assert_allclose(mesh.vertices + mesh.center, BOX.vertices, atol=1e-6)
    glb.json["nodes"] = [{"mesh": 0, **visible(False)}]
    glb.json["scenes"] = [{"nodes": [0]}]
    with pytest.raises(InputError, match=r"box\.glb"):
        load(glb, tmp_path)


def test_hidden_nodes_still_move_what_hangs_on_them_as_joints(tmp_path: Path) -> None:
    glb = textured_glb()
    count = len(BOX.vertices)
    glb.add("JOINTS_0", np.zeros((count, 4), "u1"))
    glb.add("WEIGHTS_0", np.tile(np.array([1, 0, 0, 0], "<f4"), (count, 1)))
    hidden = {"extensions": {"KHR_node_visibility": {"visible": False}}}
    glb.json["nodes"] = [{"mesh": 0, "skin": 0}, {"translation": [0.1, 0.2, 0.3], **hidden}]
    glb.json["skins"] = [{"joints": [1]}]
    glb.json["scenes"] = [{"nodes": [0, 1]}]
    mesh = load(glb, tmp_path)
    moved = BOX.vertices + (0.1, 0.2, 0.3)
    np.testing.assert_allclose(mesh.vertices + mesh.center, moved, atol=1e-6)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"extensionsRequired": ["KHR_texture_basisu"]}, "requires KHR_texture_basisu"),
        ({"extensionsRequired": ["NV_meshopt_2"]}, "requires NV_meshopt_2"),
        ({"extensionsRequired": ["NV_new"]}, "requires NV_new"),
        ({"asset": {"version": "1.0"}}, "glTF 1.0"),
        ({"textures": [{"extensions": {"KHR_texture_basisu": {"source": 0}}}]}, "basisu"),
        ({"materials": [{"name": "m"}]}, "material m, but the whole object is of one colour"),
        ({"nodes": [{"children": [0], "mesh": 0}]}, "hangs below"),
        ({"nodes": [{"mesh": 7}]}, "cannot be read as a mesh"),
        ({"nodes": 5}, "cannot be read as a mesh"),
        ({"accessors": []}, "cannot be read as a mesh"),
    ],
)
def test_what_is_not_understood_is_refused_by_name(
    tmp_path: Path, change: dict[str, Any], words: str
) -> None:
    glb = textured_glb()
    glb.json.update(change)
    with pytest.raises(InputError, match=words) as error:
        load(glb, tmp_path)
    assert len(str(error.value)) < 400 and "\n" not in str(error.value)


def test_numbers_that_are_taken_as_millimetres_are_warned_of(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    glb = textured_glb()
    glb.json["nodes"] = [{"mesh": 0, "scale": [1000, 1000, 1000]}]
    glb.write(tmp_path / "box.glb")
    assert Mesh.load(tmp_path / "box.glb", "mm").diameter == pytest.approx(0.1414, abs=1e-3)
    assert "by the file one unit is 1 m, but the unit given is 0.001 m" in caplog.text


def test_joints_and_weights_of_all_sets_count(tmp_path: Path) -> None:
    glb = textured_glb()
    count = len(BOX.vertices)
    for number, (joints, weights) in enumerate(
        [([0, 0, 0, 0], [0.25, 0, 0, 0]), ([1, 0, 0, 0], [0.75, 0, 0, 0])]
    ):
        glb.add(f"JOINTS_{number}", np.tile(np.array(joints, "u1"), (count, 1)))
        glb.add(f"WEIGHTS_{number}", np.tile(np.array(weights, "<f4"), (count, 1)))
    glb.json["nodes"] = [{"mesh": 0, "skin": 0}, {}, {"translation": [0.4, 0.8, 0]}]
    glb.json["skins"] = [{"joints": [1, 2]}]
    glb.json["scenes"] = [{"nodes": [0, 1, 2]}]
    mesh = load(glb, tmp_path)
    moved = BOX.vertices + (0.3, 0.6, 0)
    np.testing.assert_allclose(mesh.vertices + mesh.center, moved, atol=1e-6)
