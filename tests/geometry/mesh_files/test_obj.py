"""OBJ files as people have them: textured, or refused in one sentence."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from moveit6d.errors import InputError
from moveit6d.geometry.mesh import Mesh
from tests.support.patches import BOX, all_right, shown_right

MTL = "newmtl mat\nKd 0.8 0.8 0.8\nmap_Kd skin.png\n"


def write(folder: Path, mtl: str | bytes = MTL, obj: str | bytes | None = None) -> Path:
    BOX.write_picture(folder / "skin.png")
    content = mtl.encode() if isinstance(mtl, str) else mtl
    (folder / "m.mtl").write_bytes(content)
    text = BOX.obj() if obj is None else obj
    (folder / "box.obj").write_bytes(text.encode() if isinstance(text, str) else text)
    return folder / "box.obj"


@pytest.mark.parametrize(
    "line",
    [
        "map_Kd skin.png",
        "map_Kd -s 1 1 1 skin.png",
        "map_Kd -o 0 0 0 -s 1 1 skin.png",
        "map_Kd -clamp on -blendu off -imfchan m skin.png",
        "map_Kd -mm 0 1 -bm 0.2 skin.png",
        'map_Kd "skin.png"',
        "map_Kd SKIN.PNG",
        "map_Kd ./skin.png",
        "map_Kd .\\skin.png",
        "map_Kd C:\\Users\\me\\skin.png",
        "map_Kd /home/me/skin.png",
        "map_Kd ../textures/skin.png",
        "map_Kd file:///tmp/none/skin.png",
        "map_Kd skin.png  ",
        "\tmap_Kd\tskin.png",
        "MAP_KD skin.png",
        "map_Ka skin.png",
        "map_Ke skin.png\nmap_Pr rough.png",
    ],
)
def test_pictures_are_found_however_the_line_is_written(tmp_path: Path, line: str) -> None:
    assert all_right(Mesh.load(write(tmp_path, f"newmtl mat\n{line}\n")))


@pytest.mark.parametrize(
    "mtl",
    [
        b"\xef\xbb\xbf" + MTL.encode(),
        MTL.replace("\n", "\r\n").encode(),
        "# gr\u00fc\u00dfe\n".encode("latin-1") + MTL.encode(),
        b"\xff\xfe" + MTL.encode("utf-16-le"),
    ],
)
def test_encodings_of_the_library(tmp_path: Path, mtl: bytes) -> None:
    assert all_right(Mesh.load(write(tmp_path, mtl)))


@pytest.mark.parametrize("name", ["my skin.png", "h\u00e4utchen.png", "a#b.png", "a%20b.png"])
def test_odd_names_of_pictures(tmp_path: Path, name: str) -> None:
    path = write(tmp_path, f"newmtl mat\nmap_Kd {name}\n")
    (tmp_path / "skin.png").rename(tmp_path / name)
    assert all_right(Mesh.load(path))


def test_escaped_blanks_and_folders_of_other_systems(tmp_path: Path) -> None:
    path = write(tmp_path, "newmtl mat\nmap_Kd Textures\\my%20skin.png\n")
    (tmp_path / "textures").mkdir()
    (tmp_path / "skin.png").rename(tmp_path / "textures" / "my skin.png")
    assert all_right(Mesh.load(path))


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


def test_texture_scale_offset_and_gain_of_the_library(tmp_path: Path) -> None:
    rows = BOX.obj().splitlines()
    halved = [f"vt {u / 2 - 0.1} {v / 2 - 0.2}" for u, v in BOX.uv.tolist()]
    rows = [row for row in rows if not row.startswith("vt")]
    obj = "\n".join(rows[:2] + halved + rows[2:])
    mtl = "newmtl mat\nmap_Kd -s 2 2 1 -o 0.2 0.4 0 skin.png\n"
    assert all_right(Mesh.load(write(tmp_path, mtl, obj)))


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
    from PIL import Image

    Image.fromarray(picture).save(tmp_path / "two.bmp")
    assert all_right(Mesh.load(path))


def test_a_mask_cuts_holes(tmp_path: Path) -> None:
    from PIL import Image

    mask = np.full((64, 96), 255, np.uint8)
    mask[:32, :32] = 0  # the side x = +0.05
    path = write(tmp_path, MTL + "map_d mask.png\n")
    Image.fromarray(mask).save(tmp_path / "mask.png")
    mesh = Mesh.load(path)
    centres = (mesh.vertices + mesh.center)[mesh.faces].mean(1)
    assert not (centres[:, 0] > 0.0499).any()
    assert (centres[:, 0] < -0.0499).any()


def test_concave_polygons_are_not_fanned(tmp_path: Path) -> None:
    arrow = [(0, 0), (4, 2), (0, 4), (1, 2)]  # the last corner points inwards
    rows = [f"v {x / 20} {y / 20} 0" for x, y in arrow] + ["f 2 3 4 1"]
    mesh = Mesh.load(write(tmp_path, obj="\n".join(rows)))
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
    assert area == pytest.approx(6 / 400, rel=1e-4)


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
