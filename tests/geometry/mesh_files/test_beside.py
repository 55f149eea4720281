"""Files beside a mesh are found, however they are named."""

from __future__ import annotations

from pathlib import Path

import pytest

from moveit6d.geometry.mesh import Mesh
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
