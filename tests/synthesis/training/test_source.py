"""What training pairs are made from."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from moveit6d.errors import InputError
from moveit6d.synthesis.training.source import mesh_files
from tests.support.pairs import photos, small_source


def test_every_kind_of_mesh_file_that_can_be_read_is_taken(tmp_path: Path) -> None:
    for name in ("d.PLY", "a.glb", "b.gltf", "c.off", "e.dae", "notes.txt", "a.mtl"):
        (tmp_path / name).touch()
    assert [path.name for path in mesh_files(tmp_path)] == [
        "a.glb", "b.gltf", "c.off", "d.PLY", "e.dae",
    ]  # fmt: skip


def test_a_folder_without_a_mesh_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"holds no \.obj, .*file"):
        mesh_files(tmp_path)


def test_lasting_shapes_are_everybody_s(tmp_path: Path) -> None:
    own = replace(small_source(tmp_path), shapes=2)

    def first(source: object, seed: int) -> bytes:
        assert isinstance(source, type(own))
        made = source.make_shapes(np.random.default_rng(seed), photos())
        assert len(made) == 2
        return made[0].vertices.tobytes()

    assert first(own, 0) == first(own, 0) != first(own, 1)
    assert first(replace(own, lasting=3), 0) == first(replace(own, lasting=3), 1)
    assert first(replace(own, lasting=3), 0) != first(replace(own, lasting=4), 0)


def test_a_digest_is_of_the_files_and_not_of_their_place(tmp_path: Path, brick_file: Path) -> None:
    found = set()
    for place in ("one", "two"):
        folder = tmp_path / place
        folder.mkdir()
        (folder / "photos").mkdir()
        (folder / "brick.ply").write_bytes(brick_file.read_bytes())
        source = replace(small_source(folder / "photos"), meshes=(folder / "brick.ply",))
        found.add(source.digest())
    assert len(found) == 1
    (folder / "photos" / "notes.txt").touch()
    assert source.digest() in found, "what is no picture does not count"
    (folder / "brick.symmetry.json").write_text('{"symmetries_discrete": []}')
    assert source.digest() not in found
    with pytest.raises(InputError, match=r"Photo folder .*nowhere does not exist"):
        replace(source, photos=tmp_path / "nowhere").digest()
