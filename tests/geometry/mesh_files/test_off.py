"""OFF: colours of vertices and faces."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from moveit6d.errors import InputError
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.mesh_files.join import PLAIN
from tests.support.patches import BOX, all_right


def test_coff_and_colours_of_faces(tmp_path: Path) -> None:
    vertices, faces, colors = BOX.quads()
    rows = ["COFF", "# made", "96 48 0"]
    rows += ["{} {} {} ".format(*v) + "{} {} {} 255".format(*c)
             for v, c in zip(vertices, colors, strict=True)]  # fmt: skip
    rows += ["3 {} {} {}".format(*face) for face in faces]
    (tmp_path / "a.off").write_text("\n".join(rows))
    assert all_right(Mesh.load(tmp_path / "a.off"))
    rows = ["OFF 96 24 0"] + ["{} {} {}".format(*v) for v in vertices]
    rows += [f"4 {4 * k} {4 * k + 1} {4 * k + 2} {4 * k + 3} " + "{} {} {}".format(*colors[4 * k])
             for k in range(24)]  # fmt: skip
    (tmp_path / "b.off").write_text("\n".join(rows))
    assert all_right(Mesh.load(tmp_path / "b.off"))
    (tmp_path / "b.off").write_text("\n".join(rows[:-3]))
    with pytest.raises(InputError, match="cut off"):
        Mesh.load(tmp_path / "b.off")


POINTS = ["0 0 0", "1 0 0", "0 1 0", "0 0 1"]
CORNERS = ["3 0 2 1", "3 0 1 3", "3 0 3 2", "3 1 2 3"]
TINTS = ["255 0 0", "0 255 0 255", "0 0 255"]


def tetrahedron(path: Path, points: list[str], faces: list[str], head: str = "OFF") -> Path:
    path.write_text("\n".join([head, "4 4 6", *points, *faces]))
    return path


@pytest.mark.parametrize("what", ["vertices", "faces"])
def test_rows_without_a_colour_are_grey_and_the_others_keep_theirs(
    tmp_path: Path, what: str, caplog: pytest.LogCaptureFixture
) -> None:
    points, faces = list(POINTS), list(CORNERS)
    rows = points if what == "vertices" else faces
    rows[:3] = [f"{row} {tint}" for row, tint in zip(rows, TINTS, strict=False)]
    mesh = Mesh.load(tetrahedron(tmp_path / "a.off", points, faces))
    assert mesh.vertex_colors is not None
    shown = mesh.vertex_colors if what == "vertices" else mesh.vertex_colors[mesh.faces[:, 0]]
    np.testing.assert_array_equal(shown, [(255, 0, 0), (0, 255, 0), (0, 0, 255), PLAIN])
    assert f"1 of 4 {what} have no colour and are shown grey" in caplog.text


@pytest.mark.parametrize("what", ["vertices", "faces"])
def test_colours_by_number_are_lost_and_said_to_be(tmp_path: Path, what: str) -> None:
    points, faces = list(POINTS), list(CORNERS)
    rows = points if what == "vertices" else faces
    rows[0] += " 255 0 0"
    rows[1] += " 4"
    path = tetrahedron(tmp_path / "a.off", points, faces)
    with pytest.raises(InputError, match=f"1 of 4 {what} have a colour by its number"):
        Mesh.load(path)
    mesh = Mesh.load(path, allow_untextured=True)
    assert mesh.vertex_colors is not None
    assert {tuple(c) for c in mesh.vertex_colors.tolist()} == {(255, 0, 0), PLAIN}


def test_texture_coordinates_are_no_colours(tmp_path: Path) -> None:
    points = [f"{point} 0.5 1" for point in POINTS]
    mesh = Mesh.load(tetrahedron(tmp_path / "a.off", points, CORNERS, "STOFF"))
    assert (mesh.vertex_colors == PLAIN).all()
