"""The looks of PLY files: coordinates of some faces only, and materials."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from moveit6d.errors import InputError
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.mesh_files.join import PLAIN
from tests.support.patches import BOX, shown_right
from tests.support.ply_files import ply

RGB = ("red", "green", "blue")


def partly_textured(folder: Path, form: str, colored: bool) -> Path:
    """The box with its picture, of which the last two faces have no texture coordinates."""
    BOX.write_picture(folder / "skin.png")
    head = ["comment TextureFile skin.png", "element vertex 24"]
    head += [f"property float {name}" for name in "xyz"]
    head += [f"property uchar {name}" for name in RGB] * colored
    head += ["element face 12", "property list uchar int vertex_indices"]
    head += ["property list uchar float texcoord"]
    tint = [7, 77, 177] if colored else []
    rows = [[*point, *tint] for point in BOX.vertices.tolist()]
    uv = [BOX.uv[face].reshape(-1).tolist() for face in BOX.faces]
    lists = [[3, *face, 6, *own] for face, own in zip(BOX.faces.tolist(), uv, strict=True)]
    lists[-2:] = [[*row[:4], 0] for row in lists[-2:]]
    path = folder / "box.ply"
    if form == "ascii":
        path.write_text(ply(head, [" ".join(map(str, row)) for row in rows + lists]))
        return path
    kind = np.dtype([("p", "<f4", 3), ("c", "u1", len(tint))])
    body = np.array([(row[:3], row[3:]) for row in rows], kind).tobytes()
    for row in lists:
        body += b"\3" + np.array(row[1:4], "<i4").tobytes() + bytes([row[4]])
        body += np.array(row[5:], "<f4").tobytes()
    path.write_bytes(ply(head, [], form).encode() + body)
    return path


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian"])
@pytest.mark.parametrize("colored", [False, True])
def test_faces_without_coordinates_cost_no_other_face_its_picture(
    tmp_path: Path, form: str, colored: bool, caplog: pytest.LogCaptureFixture
) -> None:
    mesh = Mesh.load(partly_textured(tmp_path, form, colored))
    right, count = shown_right(mesh)
    assert count / 2 < right < count
    assert mesh.texture is not None and mesh.uv is not None
    shown = {tuple(color) for color in mesh.texture.reshape(-1, 3).tolist()}
    mean = BOX.picture.reshape(-1, 3).mean(0).round()
    what = "their own colours" if colored else "the picture's mean colour"
    assert ((7, 77, 177) if colored else tuple(mean.tolist())) in shown
    assert f"2 of 12 faces have no texture coordinates and take {what}" in caplog.text


def test_coordinates_of_no_face_are_a_loss(tmp_path: Path) -> None:
    path = partly_textured(tmp_path, "ascii", False)
    rows = path.read_text().splitlines()
    rows[-12:] = [" ".join(row.split()[:4]) + " 0" for row in rows[-12:]]
    path.write_text("\n".join(rows))
    with pytest.raises(InputError, match="has no texture coordinates"):
        Mesh.load(path)


def with_materials(
    path: Path, index: list[int], element: str = "face", names: tuple[str, ...] = RGB
) -> Path:
    """The box with a red and a blue material, which its vertices or faces name by `index`."""
    named = ["property int material_index"]
    head = ["element vertex 24"] + [f"property float {name}" for name in "xyz"]
    head += named if element == "vertex" else []
    head += ["element face 12", "property list uchar int vertex_indices"]
    head += named if element == "face" else []
    head += ["element material 2", "property uchar ambient_red"]
    head += [f"property uchar diffuse_{name}" for name in names]
    rows = ["{} {} {}".format(*point) for point in BOX.vertices]
    faces = ["3 {} {} {}".format(*face) for face in BOX.faces]
    for where, lines in (("vertex", rows), ("face", faces)):
        if where == element:
            lines[:] = [f"{line} {k}" for line, k in zip(lines, index, strict=True)]
    colors = [" ".join(map(str, color[: len(names)])) for color in ((200, 9, 9), (9, 9, 200))]
    path.write_text(ply(head, rows + faces + [f"0 {color}" for color in colors]))
    return path


@pytest.mark.parametrize(("element", "count"), [("face", 12), ("vertex", 24)])
def test_materials_by_number(
    tmp_path: Path, element: str, count: int, caplog: pytest.LogCaptureFixture
) -> None:
    index = [0, 1, 7] * (count // 3)
    mesh = Mesh.load(with_materials(tmp_path / "box.ply", index, element))
    assert mesh.vertex_colors is not None
    shown = mesh.vertex_colors if element == "vertex" else mesh.vertex_colors[mesh.faces[:, 0]]
    np.testing.assert_array_equal(shown, [(200, 9, 9), (9, 9, 200), PLAIN] * (count // 3))
    assert f"{count // 3} of {count} values of material_index name none" in caplog.text


def test_materials_that_cannot_be_shown_are_a_loss(tmp_path: Path) -> None:
    path = with_materials(tmp_path / "box.ply", [0, 1] * 6, names=("red",))
    with pytest.raises(InputError, match="its materials have no diffuse_red, diffuse_green and"):
        Mesh.load(path)
    path = with_materials(tmp_path / "box.ply", [], "neither")
    with pytest.raises(InputError, match="no material_index says which of its 2 materials"):
        Mesh.load(path)
    mesh = Mesh.load(path, allow_untextured=True)
    assert (mesh.vertex_colors == PLAIN).all()
