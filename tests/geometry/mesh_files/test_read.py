"""Mesh files of any format: what is refused, and which colour is meant."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from moveit6d.errors import InputError
from moveit6d.geometry.mesh import Mesh
from tests.support.patches import BOX, all_right
from tests.support.ply_files import ply


def one_coloured(color: str) -> str:
    """A PLY of which every vertex says the same colour."""
    channels = [f"property uchar {name}" for name in ("red", "green", "blue")]
    axes = [f"property float {name}" for name in "xyz"]
    count = len(BOX.vertices)
    head = [f"element vertex {count}", *axes, *channels, f"element face {len(BOX.faces)}"]
    rows = ["{} {} {} ".format(*point) + color for point in BOX.vertices.tolist()]
    faces = ["3 {} {} {}".format(*face) for face in BOX.faces.tolist()]
    return ply([*head, "property list uchar int vertex_indices"], rows + faces)


def test_one_colour_that_every_vertex_says_is_meant_but_grey_is_none(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "red.ply").write_text(one_coloured("190 12 10"))
    mesh = Mesh.load(tmp_path / "red.ply", "m")
    assert mesh.vertex_colors is not None
    np.testing.assert_array_equal(mesh.vertex_colors[0], (190, 12, 10))
    assert "one colour" in caplog.text
    for lost in ("255 255 255", "128 128 128"):
        (tmp_path / "grey.ply").write_text(one_coloured(lost))
        with pytest.raises(InputError, match="one colour"):
            Mesh.load(tmp_path / "grey.ply", "m")


def test_a_folder_or_a_pipe_is_no_mesh(tmp_path: Path) -> None:
    import os

    (tmp_path / "a.obj").mkdir()
    os.mkfifo(tmp_path / "b.ply")
    for name in ("a.obj", "b.ply"):
        with pytest.raises(InputError, match="not a regular file"):
            Mesh.load(tmp_path / name)


def test_vertices_that_no_face_uses_may_hold_anything(tmp_path: Path) -> None:
    from moveit6d.geometry.mesh_files import read_mesh_file

    BOX.write_picture(tmp_path / "skin.png")
    count = len(BOX.vertices) + 1
    names = ("x", "y", "z", "texture_u", "texture_v")
    head = ["comment TextureFile skin.png", f"element vertex {count}"]
    head += [f"property float {name}" for name in names]
    head += [f"element face {len(BOX.faces)}", "property list uchar int vertex_indices"]
    rows = np.concatenate([np.full((1, 5), np.nan), np.hstack([BOX.vertices, BOX.uv])])
    lines = [" ".join(map(str, row)) for row in rows.tolist()]
    path = tmp_path / "box.ply"
    path.write_text(ply(head, lines + ["3 {} {} {}".format(*f) for f in BOX.faces + 1]))
    surface, _ = read_mesh_file(path)
    assert np.isfinite(surface.vertices).all()
    mesh = Mesh.load(path)
    assert all_right(mesh)
    assert mesh.diameter == pytest.approx(np.sqrt(0.1**2 + 0.08**2 + 0.06**2))
    path.write_text(ply(head, lines + ["3 {} {} {}".format(*f) for f in BOX.faces]))
    with pytest.raises(InputError, match="not finite"):
        Mesh.load(path)
