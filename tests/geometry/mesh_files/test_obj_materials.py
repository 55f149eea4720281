"""Materials of OBJ files: libraries found, looks shown or named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from moveit6d.errors import InputError
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.mesh_files.join import PLAIN
from tests.support.obj_files import MTL, write
from tests.support.patches import BOX, all_right, shown_right


@pytest.mark.parametrize(
    "head",
    [
        "mtllib m.mtl\n",  # no usemtl, as the files of the YCB site
        "mtllib none.mtl m.mtl\nusemtl mat\n",
        "mtllib none.mtl\nmtllib m.mtl\nusemtl mat\n",
        "mtllib M.MTL\nusemtl MAT \n",
        "mtllib /home/me/m.mtl\nusemtl mat\n",
        "\ufeffmtllib m.mtl\nusemtl mat\n",
        "mtllib m.mtl\nusemtl mat\ng a\no b\ns 1\nvn 0 0 1\n",
    ],
)
def test_libraries_are_found_however_the_file_names_them(tmp_path: Path, head: str) -> None:
    assert all_right(Mesh.load(write(tmp_path, obj=BOX.obj(head))))


def test_a_library_beside_the_file_is_used_if_the_named_one_is_missing(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = write(tmp_path, obj=BOX.obj("mtllib old_name.mtl\nusemtl mat\n"))
    (tmp_path / "m.mtl").rename(tmp_path / "box.mtl")
    assert all_right(Mesh.load(path))
    assert "box.mtl" in caplog.text


@pytest.mark.parametrize(
    ("mtl", "head", "words"),
    [
        (MTL, "mtllib gone.mtl\nusemtl mat\n", "gone.mtl is not there"),
        (MTL, "mtllib gone.mtl\n", "gone.mtl is not there"),
        (MTL, "usemtl mat\n", "no mtllib line"),
        (MTL, "mtllib m.mtl\nusemtl other\n", "'other'.*define only 'mat'"),
        ("newmtl mat\nmap_Kd none.png\n", "mtllib m.mtl\nusemtl mat\n", "none.png.*not there"),
        ("newmtl mat\nmap_Kd m.mtl\n", "mtllib m.mtl\nusemtl mat\n", "not a readable picture"),
        ("newmtl mat\nKd 1 1 1\n", "mtllib m.mtl\nusemtl mat\n", "material mat, but the whole"),
        ("newmtl a\nKd 1 0 0\nnewmtl b\nKd 0 1 0\n", "mtllib m.mtl\n", "no usemtl says which"),
        ("", "mtllib m.mtl\nusemtl mat\n", "material 'mat'"),
    ],
)
def test_lost_looks_are_named_or_warned_of(
    tmp_path: Path, mtl: str, head: str, words: str, caplog: pytest.LogCaptureFixture
) -> None:
    path = write(tmp_path, mtl, BOX.obj(head))
    with pytest.raises(InputError, match=words) as error:
        Mesh.load(path)
    assert "allow_untextured" in str(error.value) and "\n" not in str(error.value)
    assert str(path) in str(error.value)
    mesh = Mesh.load(path, allow_untextured=True)
    assert (mesh.vertex_colors == mesh.vertex_colors[0]).all()
    assert str(path) in caplog.text


def test_faces_without_coordinates_take_the_mean_colour(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    lines = BOX.obj().splitlines()
    lines[-1] = "f " + " ".join(part.split("/")[0] for part in lines[-1].split()[1:])
    mesh = Mesh.load(write(tmp_path, obj="\n".join(lines)))
    right, count = shown_right(mesh)
    assert count / 2 < right < count
    assert "1 of 12 faces" in caplog.text


@pytest.mark.parametrize("scale", [1.0, 255.0])
@pytest.mark.parametrize("head", ["", "mtllib gone.mtl\nusemtl x\n", "mtllib m.mtl\nusemtl mat\n"])
def test_vertex_colours_with_and_without_material(tmp_path: Path, head: str, scale: float) -> None:
    vertices, faces, colors = BOX.quads()
    rows = np.concatenate([vertices, colors / 255 * scale], 1).tolist()
    obj = head + "\n".join("v " + " ".join(f"{x:.6f}" for x in row) for row in rows)
    obj += "\n" + "\n".join("f {} {} {}".format(*row) for row in (faces + 1).tolist())
    assert all_right(Mesh.load(write(tmp_path, "newmtl mat\nKd 0.5 0.5 0.5\n", obj)))


def test_several_materials_whose_coordinates_repeat(tmp_path: Path) -> None:
    """Sides 0 to 2 show one picture and 3 to 5 another, moved by whole tiles."""
    shifted = BOX.uv + np.repeat([[0, 0], [3, 0], [-2, 5], [1, 1], [0, -4], [7, 7]], 4, axis=0)
    rows = ["mtllib m.mtl"]
    rows += ["v {} {} {}".format(*row) for row in BOX.vertices]
    rows += ["vt {} {}".format(*row) for row in shifted]
    for k, face in enumerate(BOX.faces + 1):
        rows += ["usemtl a" if k < 6 else "usemtl b", "f {0}/{0} {1}/{1} {2}/{2}".format(*face)]
    path = write(tmp_path, "newmtl a\nmap_Kd skin.png\nnewmtl b\nmap_Kd two.bmp\n", "\n".join(rows))
    picture = BOX.picture.copy()
    picture[0, 0] ^= 1
    Image.fromarray(picture).save(tmp_path / "two.bmp")
    assert all_right(Mesh.load(path))


def test_the_picture_itself_as_mask_cuts_nothing_out(tmp_path: Path) -> None:
    """Exporters name it for the sake of an alpha that it need not have."""
    for mask in ("skin.png", "./skin.png"):
        assert all_right(Mesh.load(write(tmp_path, MTL + f"map_d {mask}\n")))
    alpha = np.full(BOX.picture.shape[:2], 255, np.uint8)
    alpha[:, :32] = 0  # two of the six sides
    path = write(tmp_path, MTL + "map_d skin.png\n")
    Image.fromarray(np.dstack([BOX.picture, alpha])).save(tmp_path / "skin.png")
    right, count = shown_right(Mesh.load(path))
    assert 0 < right < count


def test_pictures_of_one_name_in_two_folders(tmp_path: Path) -> None:
    for name, color in (("a", (250, 30, 30)), ("b", (30, 30, 250))):
        (tmp_path / name).mkdir()
        (tmp_path / name / "m.mtl").write_text(f"newmtl {name}\nmap_Kd tex.png\n")
        Image.new("RGB", (8, 8), color).save(tmp_path / name / "tex.png")
    rows = BOX.obj("mtllib a/m.mtl\nmtllib b/m.mtl\n").splitlines()
    first = next(k for k, row in enumerate(rows) if row.startswith("f "))
    rows[first:first] = ["usemtl a"]
    rows[first + 7 : first + 7] = ["usemtl b"]
    mesh = Mesh.load(write(tmp_path, obj="\n".join(rows)))
    assert mesh.texture is not None
    shown = {tuple(color) for color in mesh.texture.reshape(-1, 3).tolist()}
    assert {(250, 30, 30), (30, 30, 250)} <= shown


@pytest.mark.parametrize("line", ["Kd 0,9 0,1 0,1", "Kd xyz 0.4 0.2 0.1", "Kd spectral red.rfl"])
def test_a_colour_that_is_not_understood_is_named(
    tmp_path: Path, line: str, caplog: pytest.LogCaptureFixture
) -> None:
    rows = BOX.obj("mtllib m.mtl\nusemtl a\n").splitlines()
    path = write(tmp_path, f"newmtl a\nKd 1 0 0\nnewmtl b\n{line}\n", "\n".join(rows))
    Mesh.load(path, allow_flat=True)  # no face has that colour
    rows.insert(len(rows) - 4, "usemtl b")
    path.write_text("\n".join(rows))
    with pytest.raises(InputError, match=f"material 'b' of m.mtl has the colour '{line}'"):
        Mesh.load(path, allow_flat=True)
    mesh = Mesh.load(path, allow_untextured=True)
    assert mesh.vertex_colors is not None and line in caplog.text
    assert {tuple(c) for c in mesh.vertex_colors.tolist()} == {(255, 0, 0), PLAIN}
    # Where a picture shows, the colour does not count.
    assert all_right(Mesh.load(write(tmp_path, f"newmtl mat\n{line}\nmap_Kd skin.png\n")))
