"""OBJ files as people have them: textured, or refused in one sentence."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from moveit6d.errors import InputError
from moveit6d.geometry.mesh import Mesh
from tests.support.obj_files import write
from tests.support.patches import BOX, all_right


def test_relative_indices_count_back_from_their_own_line(tmp_path: Path) -> None:
    rows = ["mtllib m.mtl", "usemtl mat"]
    for side in range(6):
        corners = range(4 * side, 4 * side + 4)
        rows += ["v {} {} {}".format(*BOX.vertices[k]) for k in corners]
        rows += ["vt {} {}".format(*BOX.uv[k]) for k in corners]
        rows += ["f -4/-4 -3/-3 -2/-2 -1/-1"]
    mesh = Mesh.load(write(tmp_path, obj="\n".join(rows)))
    assert len(np.unique(np.sort(mesh.faces, 1), axis=0)) == 12
    assert all_right(mesh)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("f 1/1", "f 0/1"), "line 5[0-9]: a face names a vertex"),
        (("f 1/1", "f 99/1"), "a face names a vertex"),
        (("f 1/1", "f 1/99"), "a face names a vertex"),
        (("f 1/1", "f x/1"), "not v, v/vt"),
        (("f 1/1", "f 1000000000000000000000/1"), "a face names a vertex"),
        (("v 0.05", "v zero"), "is not a row of numbers"),
        (("v 0.050000", "v nan"), "not finite"),
        (("vt 0.0", "vt 1e38"), "texture coordinates"),
    ],
)
def test_damaged_files_are_refused(tmp_path: Path, change: tuple[str, str], words: str) -> None:
    path = write(tmp_path, obj=BOX.obj().replace(*change, 1))
    with pytest.raises(InputError, match=words):
        Mesh.load(path)


A_COLOR, ANOTHER = (0.8, 0.2, 0.4), (0.2, 0.6, 0.0)


@pytest.mark.parametrize("scale", [1, 255])
@pytest.mark.parametrize("alpha", [(1.0, 1.0), (0.4, 0.8)])
@pytest.mark.parametrize("weight", [False, True])
def test_seven_numbers_of_a_vertex(
    tmp_path: Path,
    weight: bool,
    alpha: tuple[float, float],
    scale: int,
    caplog: pytest.LogCaptureFixture,
) -> None:
    """Either x y z w r g b or x y z r g b alpha; the column that is 1 or 255 throughout tells."""
    rows, shown = [], []
    for k, row in enumerate(BOX.vertices.tolist()):
        color = [scale * x for x in (A_COLOR, ANOTHER)[k % 2]]
        rows.append([*row, 1, *color] if weight else [*row, *color, scale * alpha[k % 2]])
        shown.append([round(255 * x) for x in (A_COLOR, ANOTHER)[k % 2]])
    mesh = Mesh.load(_with_rows(tmp_path, rows))
    np.testing.assert_array_equal(mesh.vertex_colors, shown)
    assert ("seven numbers" in caplog.text) == (not weight and alpha != (1.0, 1.0))


def test_a_vertex_whose_seven_numbers_may_mean_two_things(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    rows = [[*row, 1, k % 2, 0, 1] for k, row in enumerate(BOX.vertices.tolist())]
    mesh = Mesh.load(_with_rows(tmp_path, rows))
    np.testing.assert_array_equal(mesh.vertex_colors[:2], [(255, 0, 0), (255, 255, 0)])
    assert "are read as x y z r g b alpha" in caplog.text
    caplog.clear()
    rows = [[*row, 1, 90 * (k % 2), 0, 255] for k, row in enumerate(BOX.vertices.tolist())]
    mesh = Mesh.load(_with_rows(tmp_path, rows))
    np.testing.assert_array_equal(mesh.vertex_colors[:2], [(0, 0, 255), (90, 0, 255)])
    assert "are read as x y z w r g b" in caplog.text


def _with_rows(folder: Path, rows: list[list[float]]) -> Path:
    obj = "\n".join("v " + " ".join(f"{x:.9g}" for x in row) for row in rows)
    faces = "\n".join("f {} {} {}".format(*face) for face in (BOX.faces + 1).tolist())
    return write(folder, obj=f"{obj}\n{faces}\n")
