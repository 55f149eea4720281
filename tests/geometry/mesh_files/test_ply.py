"""PLY: textures and colours of vertices and faces, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from moveit6d.errors import InputError
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.mesh_files.join import PLAIN
from tests.support.patches import BOX, all_right
from tests.support.ply_files import ply, textured_ply


@pytest.mark.parametrize("names", [("s", "t"), ("u", "v"), ("texture_u", "texture_v")])
@pytest.mark.parametrize("comment", ["skin.png", "SKIN.png", "C:\\x\\skin.png", '"skin.png"'])
def test_ply_textures(tmp_path: Path, names: tuple[str, str], comment: str) -> None:
    BOX.write_picture(tmp_path / "skin.png")
    (tmp_path / "box.ply").write_text(textured_ply(names, comment))
    assert all_right(Mesh.load(tmp_path / "box.ply"))


def test_ply_without_its_texture_is_refused(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "box.ply").write_text(textured_ply())
    with pytest.raises(InputError, match=r"'skin.png' \(comment TextureFile\) is not there"):
        Mesh.load(tmp_path / "box.ply")
    assert Mesh.load(tmp_path / "box.ply", allow_untextured=True).texture is None
    assert "skin.png" in caplog.text


@pytest.mark.parametrize("prefix", ["", "diffuse_"])
@pytest.mark.parametrize("form", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_ply_vertex_colours(tmp_path: Path, prefix: str, form: str) -> None:
    vertices, faces, colors = BOX.quads()
    order = ">" if form.endswith("big_endian") else "<"
    head = ["element vertex 96"] + [f"property float {name}" for name in "xyz"]
    head += [f"property uchar {prefix}{name}" for name in ("red", "green", "blue")]
    head += ["element face 48", "property list uchar int vertex_indices"]
    if form == "ascii":
        rows = ["{} {} {} ".format(*v) + "{} {} {}".format(*c)
                for v, c in zip(vertices, colors, strict=True)]  # fmt: skip
        rows += ["3 {} {} {}".format(*face) for face in faces]
        (tmp_path / "box.ply").write_text(ply(head, rows))
    else:
        table = np.empty(96, [("p", order + "f4", 3), ("c", "u1", 3)])
        table["p"], table["c"] = vertices, colors
        lists = np.empty(48, [("n", "u1"), ("i", order + "i4", 3)])
        lists["n"], lists["i"] = 3, faces
        body = table.tobytes() + lists.tobytes()
        (tmp_path / "box.ply").write_bytes(ply(head, [], form).rstrip("\n").encode() + b"\n" + body)
    assert all_right(Mesh.load(tmp_path / "box.ply"))


def test_ply_colours_of_faces_that_are_quads_and_triangles(tmp_path: Path) -> None:
    vertices, faces, colors = BOX.quads()
    head = ["element vertex 96"] + [f"property double {name}" for name in "xyz"]
    head += ["element face 25", "property list uchar uint vertex_index"]
    head += [f"property float {name}" for name in ("red", "green", "blue")]
    rows = ["{} {} {}".format(*row) for row in vertices]
    tints = ["{} {} {}".format(*(row / 255)) for row in colors[::4]]
    rows += [f"4 {4 * k} {4 * k + 1} {4 * k + 2} {4 * k + 3} {tints[k]}" for k in range(23)]
    rows += [f"3 {92 + a} {92 + b} {92 + c} {tints[23]}" for a, b, c in ((0, 1, 2), (0, 2, 3))]
    (tmp_path / "box.ply").write_text(ply(head, rows))
    assert all_right(Mesh.load(tmp_path / "box.ply"))


def test_ply_two_textures_by_face(tmp_path: Path) -> None:
    BOX.write_picture(tmp_path / "a.png")
    BOX.write_picture(tmp_path / "b.png")
    head = ["comment TextureFile a.png", "comment TextureFile b.png", "element vertex 24"]
    head += [f"property float {name}" for name in "xyz"]
    head += ["element face 12", "property list uchar int vertex_indices"]
    head += ["property list uchar float texcoord", "property int texnumber"]
    rows = ["{} {} {}".format(*row) for row in BOX.vertices]
    for k, face in enumerate(BOX.faces):
        uv = " ".join(map(str, BOX.uv[face].reshape(-1).tolist()))
        rows.append("3 {} {} {} 6 ".format(*face) + f"{uv} {k % 2}")
    (tmp_path / "box.ply").write_text(ply(head, rows))
    assert all_right(Mesh.load(tmp_path / "box.ply"))


@pytest.mark.parametrize("keep", [0.97, 0.7, 0.3])
def test_a_ply_that_was_cut_off_is_refused(tmp_path: Path, keep: float) -> None:
    BOX.write_picture(tmp_path / "skin.png")
    text = textured_ply()
    (tmp_path / "box.ply").write_text(text[: int(keep * len(text))].rsplit("\n", 1)[0])
    with pytest.raises(InputError, match=r"cut off or damaged"):
        Mesh.load(tmp_path / "box.ply")


def _numbered(folder: Path, numbers: list[int], corner: bool = False, pictures: int = 2) -> Path:
    """The box in two pictures, red and blue, with a `texnumber` for each face."""
    names = ["red.png", "blue.png"][:pictures]
    for name, color in zip(names, ((250, 30, 30), (30, 30, 250)), strict=False):
        picture = Image.new("RGB", (96, 64), color)
        picture.putpixel((0, 0), (0, 0, 0))  # a single colour would be refused
        picture.save(folder / name)
    own = [] if corner else ["s", "t"]
    head = [f"comment TextureFile {name}" for name in names] + ["element vertex 24"]
    head += [f"property float {name}" for name in ["x", "y", "z", *own]]
    head += ["element face 12", "property list uchar int vertex_indices"]
    head += ["property list uchar float texcoord"] * corner + ["property int texnumber"]
    table = BOX.vertices if corner else np.concatenate([BOX.vertices, BOX.uv], 1)
    rows = [" ".join(map(str, row)) for row in table.tolist()]
    for face, number in zip(BOX.faces, numbers, strict=True):
        uv = "6 " + " ".join(map(str, BOX.uv[face].reshape(-1).tolist())) if corner else ""
        rows.append("3 {} {} {} ".format(*face) + f"{uv} {number}")
    (folder / "box.ply").write_text(ply(head, rows))
    return folder / "box.ply"


def _shown(mesh: Mesh) -> list[str]:
    """The colour of each face of the box, in the order of its faces."""
    assert mesh.texture is not None and mesh.uv is not None
    centres = (mesh.vertices + mesh.center)[mesh.faces].mean(1)
    height, width = mesh.texture.shape[:2]
    names = {(250, 30, 30): "red", (30, 30, 250): "blue", PLAIN: "plain"}
    found = []
    for centre in BOX.vertices[BOX.faces].mean(1):
        face = mesh.faces[np.linalg.norm(centres - centre, axis=1).argmin()]
        u, v = mesh.uv[face].mean(0)
        texel = mesh.texture[int((1 - v) * height), int(u * width)]
        found.append(names[tuple(texel.tolist())])
    return found


@pytest.mark.parametrize("corner", [False, True])
def test_the_number_of_a_face_tells_its_picture(tmp_path: Path, corner: bool) -> None:
    mesh = Mesh.load(_numbered(tmp_path, [0, 1, -1] * 4, corner))
    assert _shown(mesh) == ["red", "blue", "plain"] * 4
    mesh = Mesh.load(_numbered(tmp_path, [1] * 12, corner))
    assert _shown(mesh) == ["blue"] * 12


@pytest.mark.parametrize("corner", [False, True])
def test_numbers_that_name_no_picture(
    tmp_path: Path, corner: bool, caplog: pytest.LogCaptureFixture
) -> None:
    assert _shown(Mesh.load(_numbered(tmp_path, [-1] * 12, corner))) == ["red"] * 12
    assert not caplog.text
    mesh = Mesh.load(_numbered(tmp_path, [0, 7] * 6, corner))
    assert _shown(mesh) == ["red", "blue"] * 6
    assert "6 of 12 faces have a texnumber beyond the 2 pictures" in caplog.text
    single = Mesh.load(_numbered(tmp_path, [0] * 12, corner, pictures=1))
    assert len(single.vertices) == (36 if corner else 24)
