"""Collada: pictures found, lost pictures named, damaged files refused."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from moveit6d.errors import InputError
from moveit6d.geometry.mesh import Mesh
from tests.support.collada_files import dae
from tests.support.patches import BOX, all_right


@pytest.mark.parametrize("kind", ["triangles", "polylist"])
@pytest.mark.parametrize("picture", ["skin.png", "file:///C:/x/SKIN.png", "./skin.png"])
def test_collada_with_a_picture(tmp_path: Path, kind: str, picture: str) -> None:
    BOX.write_picture(tmp_path / "skin.png")
    (tmp_path / "box.dae").write_text(dae(kind, picture))
    mesh = Mesh.load(tmp_path / "box.dae", "cm")
    assert len(mesh.faces) == 12
    assert all_right(mesh)


def test_collada_whose_picture_is_lost(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "box.dae").write_text(dae())
    with pytest.raises(InputError, match=r"material 'skin'.*'skin.png'.*not there"):
        Mesh.load(tmp_path / "box.dae", "cm")
    (tmp_path / "box.dae").write_text(dae(shown=False))
    with pytest.raises(InputError, match=r"one colour, RGB \(255, 0, 0\)"):
        Mesh.load(tmp_path / "box.dae", "cm")
    mesh = Mesh.load(tmp_path / "box.dae", "cm", allow_untextured=True)
    np.testing.assert_array_equal(mesh.vertex_colors[0], (255, 0, 0))
    assert "one colour" in caplog.text


@pytest.mark.parametrize(
    "content", ["", "<COLLADA/>", "<a", "<!DOCTYPE a [<!ENTITY b 'c'>]><COLLADA/>"]
)
def test_collada_that_is_damaged(tmp_path: Path, content: str) -> None:
    (tmp_path / "box.dae").write_text(content)
    with pytest.raises(InputError, match=r"box\.dae"):
        Mesh.load(tmp_path / "box.dae")


def test_a_unit_that_is_not_the_file_s_is_warned_of(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    BOX.write_picture(tmp_path / "skin.png")
    path = tmp_path / "box.dae"
    path.write_text(dae())
    Mesh.load(path, "cm")
    assert not caplog.text
    Mesh.load(path, "m")
    assert (
        "box.dae: by the file one unit is 0.01 m, but the unit given is 1 m; it is 14.1 m across"
        in caplog.text
    )
    caplog.clear()
    path.write_text(dae().replace('<unit name="centimeter" meter="0.01"/>', ""))
    Mesh.load(path, "cm")  # the file says nothing
    assert not caplog.text


@pytest.mark.parametrize("kind", ["polylist", "polygons"])
def test_polygons_that_are_not_convex(tmp_path: Path, kind: str) -> None:
    """Two Us, whose fans from their first corner would fill the gap between the arms."""
    corner = [(1, 1), (1, 3), (0, 3), (0, 0), (3, 0), (3, 3), (2, 3), (2, 1)]
    points = [(x, y, z) for z in (0, 1) for x, y in corner]
    text = dae("polylist", shown=False)
    text = text.replace('count="72"', 'count="48"').replace('count="24"', 'count="16"')
    text = re.sub(r"(<float_array id=.pa.[^>]*>)[^<]*", lambda m: m[1] + _row(points), text)
    index = [" ".join(f"{k} 0" for k in range(8 * z, 8 * z + 8)) for z in (0, 1)]
    if kind == "polylist":
        own = f"<vcount>8 8</vcount><p>{' '.join(index)}</p></polylist>"
    else:
        own = f"<p>{index[0]}</p><p>{index[1]}</p></polygons>"
        text = text.replace("<polylist", "<polygons")
    text = re.sub(r"<vcount>.*</polylist>", own, text)
    (tmp_path / "u.dae").write_text(text)
    mesh = Mesh.load(tmp_path / "u.dae", allow_untextured=True)
    assert len(mesh.faces) == 12
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a) / 2
    assert np.linalg.norm(normals, axis=1).sum() == pytest.approx(2 * 7, rel=1e-6)
    assert (normals[:, 2] > 0).all() or (normals[:, 2] < 0).all()


def _row(points: list[tuple[int, int, int]]) -> str:
    return " ".join(str(value) for point in points for value in point)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ('<instance_geometry url="#gone"/>', "Geometry #gone not found"),
        ('<instance_controller url="#gone"/>', "Controller #gone not found"),
        ('<instance_light url="#gone"/>', ""),
        ('<instance_camera url="#gone"/>', ""),
    ],
)
def test_parts_that_cannot_be_found_are_warned_of(
    tmp_path: Path, more: str, words: str, caplog: pytest.LogCaptureFixture
) -> None:
    BOX.write_picture(tmp_path / "skin.png")
    text = dae().replace("</visual_scene>", f"<node>{more}</node>" * 2 + "</visual_scene>")
    (tmp_path / "box.dae").write_text(text)
    assert all_right(Mesh.load(tmp_path / "box.dae", "cm"))
    assert words in caplog.text
    assert caplog.text.count("is left out") == bool(words)
