"""Sequences in other processes: a killed one is done again, and the tracks are the same."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from moveit6d.cli.common import Setting
from moveit6d.cli.main import main
from moveit6d.cli.sequence_job import settings_of_track
from moveit6d.datasets.pose_files import read_poses
from moveit6d.datasets.sequences import read_sequence
from moveit6d.geometry.pose import Pose
from moveit6d.geometry.symmetry import Symmetries
from moveit6d.networks.correlation import CorrelationConfig, CorrelationNet
from moveit6d.networks.weights_file import save_network

Make = Callable[..., Any]


TINY = CorrelationConfig(channels=(4, 6, 8), geometry=(4, 4, 4), context=8, decoder=8, fine=8)


def test_two_processes_with_one_killed_give_the_same_tracks(
    make_sequence: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    from moveit6d.cli import sequence_job
    from tests.support import killed_sequence

    for name in ("easy_00", "easy_01", "hard_00"):
        made = make_sequence(name, frames=3)
    weights = tmp_path / "weights.safetensors"
    torch.manual_seed(0)
    save_network(CorrelationNet(TINY), weights)
    command = [
        "benchmark",
        "tracking",
        "--sequences",
        str(made.folder.parent),
        "--weights",
        str(weights),
        "--no_recovery",  # the object is lost: of such weights every pose is wrong
        "--max_iterations",
        "2",
        "--output",
    ]
    assert main([*command, str(tmp_path / "one")]) == 0
    monkeypatch.setattr(sequence_job, "work", killed_sequence.work)
    monkeypatch.setenv(killed_sequence.FOLDER, str(tmp_path))
    assert main([*command, str(tmp_path / "two"), "--jobs", "2"]) == 0
    assert (tmp_path / "killed").exists()
    for name in ("easy_00", "easy_01", "hard_00"):
        one, two = (read_poses(tmp_path / place / f"{name}.csv") for place in ("one", "two"))
        assert [replace(row, milliseconds=None, pose=None) for row in one] == [
            replace(row, milliseconds=None, pose=None) for row in two
        ]
        for mine, theirs in zip(one, two, strict=True):
            assert mine.pose is not None and theirs.pose is not None
            assert torch.equal(mine.pose.rotation, theirs.pose.rotation)
            assert torch.equal(mine.pose.translation, theirs.pose.translation)
    assert not list((tmp_path / "two").glob(".*")), "a killed worker leaves nothing behind"


def settings(sequence: Any, protocol: str = "none") -> dict[str, Any]:
    return settings_of_track(sequence, Setting(None, "embree", 1), protocol)


def test_a_track_belongs_to_its_images_camera_and_object(make_sequence: Make) -> None:
    made = make_sequence(frames=3)
    (sequence,) = read_sequence(made.folder)
    before = settings(sequence)
    assert json.loads(json.dumps(before)) == before == settings(read_sequence(made.folder)[0])
    half_turn = np.diag([-1.0, -1.0, 1.0, 1.0])[None]
    (made.folder / "mesh.symmetry.json").write_text('{"symmetries_discrete": "no list"}')
    found = settings(sequence)
    assert found == {**before, "symmetries": None, "mesh": found["mesh"]}, "the track will say why"
    (made.folder / "mesh.symmetry.json").unlink()
    for other in (
        replace(sequence, camera=replace(sequence.camera, fx=181.0)),
        replace(sequence, camera=replace(sequence.camera, distortion=(0.1, 0.0, 0.0, 0.0))),
        replace(sequence, mesh_unit="mm"),
        replace(sequence, symmetries=Symmetries(half_turn)),
        replace(sequence, images=tuple(sorted(sequence.frames.iterdir()))[1:]),
        replace(sequence, frames=made.folder / "nowhere.mp4"),
    ):
        found = settings(other)
        assert found != before and json.loads(json.dumps(found)) == found


def test_other_images_of_the_same_names_are_another_video(make_sequence: Make) -> None:
    made = make_sequence(frames=3)
    (sequence,) = read_sequence(made.folder)
    first, last = (made.folder / "frames" / f"{k:06d}.png" for k in (0, 2))
    found = [settings(sequence)]
    first.write_bytes(bytes(first.stat().st_size))  # of the same size
    found.append(settings(sequence))
    last.write_bytes(last.read_bytes() + b"more")
    found.append(settings(sequence))
    last.unlink()
    found.append(settings(sequence))
    (made.folder / "frames" / "notes.txt").write_text("no frame")
    assert settings(sequence) == found[-1]
    assert len({one["images"] for one in found}) == 4


def test_a_track_with_resets_belongs_to_its_truth(make_sequence: Make) -> None:
    (sequence,) = read_sequence(make_sequence(frames=3).folder)
    other = replace(sequence, truth={**sequence.truth, 2: Pose.identity()})
    assert settings(sequence, "paper") != settings(other, "paper")
    assert settings(sequence) == settings(other), "which never sees it"


def test_a_track_belongs_to_the_texture_of_its_object(make_sequence: Make) -> None:
    (sequence,) = read_sequence(make_sequence(frames=2).folder)
    named = b"comment TextureFile brick.png\nend_header"
    sequence.mesh.write_bytes(sequence.mesh.read_bytes().replace(b"end_header", named, 1))
    found = []
    for texture in (b"red", b"blue"):
        (sequence.mesh.parent / "brick.png").write_bytes(texture)
        found.append(settings(sequence)["mesh"])
    assert found[0] != found[1]
    sequence.mesh.unlink()
    assert settings(sequence)["mesh"] is None, "the track will say that it is missing"
