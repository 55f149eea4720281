"""Files beside a mesh are found, however they are named."""

from __future__ import annotations

from pathlib import Path

import pytest

from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.mesh_files.beside import decoded
from tests.support.obj_files import write
from tests.support.patches import all_right


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


@pytest.mark.parametrize("order", ["le", "be"])
@pytest.mark.parametrize("mark", ["", "\ufeff"])
def test_utf_16_with_and_without_its_mark(tmp_path: Path, order: str, mark: str) -> None:
    path = write(tmp_path)
    for file in (path, tmp_path / "m.mtl"):
        text = mark + "# h\u00e4utchen \u7bb1\n" + file.read_text()
        file.write_bytes(text.encode(f"utf-16-{order}"))
    assert all_right(Mesh.load(path))


@pytest.mark.parametrize(
    ("content", "text"),
    [
        (b"", ""),
        (b"v", "v"),
        (b"v 1 2 3\n" + bytes(40), "v 1 2 3\n" + "\0" * 40),
        ("\u7bb1\u5b50".encode(), "\u7bb1\u5b50"),
        ("h\u00e4utchen".encode("latin-1"), "h\u00e4utchen"),
    ],
)
def test_what_is_no_utf_16(content: bytes, text: str) -> None:
    assert decoded(content) == text
