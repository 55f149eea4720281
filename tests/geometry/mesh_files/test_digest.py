"""A mesh file's fingerprint changes with all that makes its looks, and with nothing else."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from moveit6d.errors import InputError
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.mesh_files.digest import mesh_digest

OBJ = """mtllib {library}
v 0 0 0
v 0.1 0 0
v 0 0.1 0
v 0 0 0.1
vt 0 0
vt 1 0
vt 0 1
usemtl skin
f 1/1 3/2 2/3
f 1/1 2/2 4/3
f 1/1 4/2 3/3
f 2/1 3/2 4/3
"""


def picture(path: Path, value: int) -> None:
    path.parent.mkdir(exist_ok=True)
    pixels = np.arange(64, dtype=np.uint8).reshape(8, 8, 1) + np.zeros((1, 1, 3), np.uint8)
    Image.fromarray(np.asarray(pixels + value, np.uint8)).save(path)


@pytest.fixture
def can(tmp_path: Path) -> Path:
    """An object with its material library and its picture, under names that are hard to find."""
    folder = tmp_path / "given"
    folder.mkdir()
    (folder / "can.obj").write_text(OBJ.format(library="my skin.mtl"))
    (folder / "my skin.mtl").write_text("newmtl skin\nmap_Kd -s 1 1 1 maps/front side.bmp\n")
    picture(folder / "maps" / "front side.bmp", 0)
    assert Mesh.load(folder / "can.obj").texture is not None
    return folder / "can.obj"


def test_it_is_the_same_wherever_the_same_files_lie(can: Path, tmp_path: Path) -> None:
    before = mesh_digest(can)
    shutil.copytree(can.parent, tmp_path / "elsewhere")
    assert mesh_digest(tmp_path / "elsewhere" / "can.obj") == before
    (tmp_path / "linked").mkdir()
    (tmp_path / "linked" / "can.obj").symlink_to(can)
    assert mesh_digest(tmp_path / "linked" / "can.obj") == before
    (can.parent / "notes.txt").write_text("of no consequence")
    picture(can.parent / "maps" / "another.bmp", 9)
    assert mesh_digest(can) == before


@pytest.mark.parametrize("changed", ["picture", "material", "mesh", "symmetry", "models_info"])
def test_it_changes_with_everything_that_pairs_show(can: Path, changed: str) -> None:
    before = mesh_digest(can)
    if changed == "picture":  # of the same size
        picture(can.parent / "maps" / "front side.bmp", 1)
    elif changed == "material":
        library = can.parent / "my skin.mtl"
        library.write_text(library.read_text().replace("-s 1 1 1", "-s 2 2 1"))
    elif changed == "mesh":
        can.write_text(can.read_text().replace("v 0.1", "v 0.2"))
    elif changed == "symmetry":
        (can.parent / "can.symmetry.json").write_text('{"symmetries_discrete": []}')
    else:
        (can.parent / "models_info.json").write_text("{}")
    assert mesh_digest(can) != before


def test_names_in_files_of_another_encoding_count(can: Path) -> None:
    for file in (can, can.parent / "my skin.mtl"):
        file.write_bytes(file.read_text().encode("utf-16-le"))
    before = mesh_digest(can)
    picture(can.parent / "maps" / "front side.bmp", 1)
    assert mesh_digest(can) != before


def test_a_library_that_no_line_names_counts(can: Path) -> None:
    can.write_text(can.read_text().replace("mtllib my skin.mtl\n", ""))
    (can.parent / "my skin.mtl").rename(can.parent / "can.mtl")
    before = mesh_digest(can)
    (can.parent / "can.mtl").write_text("newmtl skin\nKd 1 0 0\n")
    assert mesh_digest(can) != before


def test_buffers_and_pictures_of_a_gltf_file_count(tmp_path: Path) -> None:
    uris = '{"buffers": [{"uri": "a%20b.bin"}], "images": [{"uri":"skin.png"}]}'
    (tmp_path / "can.gltf").write_text(uris)
    (tmp_path / "a b.bin").write_bytes(b"0")
    (tmp_path / "skin.png").write_bytes(b"0")
    found = {mesh_digest(tmp_path / "can.gltf")}
    for name in ("a b.bin", "skin.png"):
        (tmp_path / name).write_bytes(b"1")
        found.add(mesh_digest(tmp_path / "can.gltf"))
    assert len(found) == 3


def test_a_file_that_is_not_there_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.obj cannot be read"):
        mesh_digest(tmp_path / "none.obj")
