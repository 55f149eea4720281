"""MTL libraries: encodings, names of pictures, scale, offset and gain."""

from __future__ import annotations

from pathlib import Path

import pytest

from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.mesh_files.mtl import read_mtl
from tests.support.obj_files import MTL, write
from tests.support.patches import BOX, all_right


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
        "  map_Kd\tskin.png",
        "map_Kd\t-s 1 1 1 skin.png",
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


def test_texture_scale_offset_and_gain_of_the_library(tmp_path: Path) -> None:
    rows = BOX.obj().splitlines()
    halved = [f"vt {u / 2 - 0.1} {v / 2 - 0.2}" for u, v in BOX.uv.tolist()]
    rows = [row for row in rows if not row.startswith("vt")]
    obj = "\n".join(rows[:2] + halved + rows[2:])
    mtl = "newmtl mat\nmap_Kd -s 2 2 1 -o 0.2 0.4 0 skin.png\n"
    assert all_right(Mesh.load(write(tmp_path, mtl, obj)))


def test_tabs_and_blanks_on_one_line(tmp_path: Path) -> None:
    library = tmp_path / "m.mtl"
    library.write_text("newmtl\tmy red\n  Kd\t0.8 0.1\t0.1\nmap_Kd\tmy tex.png\nmap_d\tm 1.png\n")
    material = read_mtl(library)["my red"]
    assert material.color == (0.8, 0.1, 0.1)
    assert material.picture is not None and material.picture.name == "my tex.png"
    assert material.mask is not None and material.mask.name == "m 1.png"


@pytest.mark.parametrize(
    ("line", "color"),
    [
        ("Kd 0.5 0.25 1", (0.5, 0.25, 1.0)),
        ("Kd 5e-1", (0.5, 0.5, 0.5)),
        ("Kd 0.5 # grey", (0.5, 0.5, 0.5)),
        ("Kd 1 0 0 1  # with alpha", (1.0, 0.0, 0.0)),
        ("Kd xyz 1 1 1\nKd 1 0 0", (1.0, 0.0, 0.0)),
        ("Kd 0,5 0,5 0,5", None),
        ("Kd xyz 1 1 1", None),
        ("Kd spectral red.rfl 1", None),
        ("Kd 0.5 0.5", None),
        ("Kd", None),
    ],
)
def test_plain_colours(tmp_path: Path, line: str, color: tuple[float, ...] | None) -> None:
    library = tmp_path / "m.mtl"
    library.write_text(f"newmtl a\n{line}\n")
    material = read_mtl(library)["a"]
    assert material.color == color
    assert material.unread == (line if color is None else "")
