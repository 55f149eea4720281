"""What training pairs are made from."""

from pathlib import Path

import pytest

from moveit6d.errors import InputError
from moveit6d.synthesis.training.source import mesh_files


def test_every_kind_of_mesh_file_that_can_be_read_is_taken(tmp_path: Path) -> None:
    for name in ("d.PLY", "a.glb", "b.gltf", "c.off", "e.dae", "notes.txt", "a.mtl"):
        (tmp_path / name).touch()
    assert [path.name for path in mesh_files(tmp_path)] == [
        "a.glb", "b.gltf", "c.off", "d.PLY", "e.dae",
    ]  # fmt: skip


def test_a_folder_without_a_mesh_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"holds no \.obj, .*file"):
        mesh_files(tmp_path)
