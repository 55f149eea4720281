"""Data are called what they are: a surrogate unless they are the published set."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from moveit6d.datasets import laval, ycbv
from moveit6d.datasets.sequences import read_sequences
from moveit6d.errors import InputError
from moveit6d.evaluation.reproduce.data import YCBV_KEYFRAMES, choose, describe, is_published


def a_published_ycbv(folder: Path) -> Path:
    """What `is_published` looks at, and no more."""
    lines = [f"{scene:04d}/{k:06d}" for scene, n in YCBV_KEYFRAMES.items() for k in range(1, n + 1)]
    folder.mkdir()
    (folder / "keyframe.txt").write_text("\n".join(lines) + "\n")
    for name in ycbv.OBJECTS:
        (folder / "models" / name).mkdir(parents=True)
        (folder / "models" / name / "points.xyz").touch()
    return folder


def test_the_published_test_set_has_2949_keyframes() -> None:
    assert sum(YCBV_KEYFRAMES.values()) == 2949 and len(YCBV_KEYFRAMES) == 12


def test_the_published_ycbv_is_recognised(tmp_path: Path) -> None:
    folder = a_published_ycbv(tmp_path / "ycb")
    assert describe(folder, "ycbv") == "YCB-Video as published, folder ycb"
    (folder / "models" / ycbv.OBJECTS[3] / "points.xyz").unlink()
    assert describe(folder, "ycbv").startswith("surrogate (in YCB-Video's format, not recognised")


def test_what_says_that_it_was_made_is_never_published(tmp_path: Path) -> None:
    folder = a_published_ycbv(tmp_path / "ycb")
    (folder / "surrogate.json").write_text(json.dumps({"what": "surrogate for YCB-Video"}))
    assert not is_published(folder, "ycbv")
    assert describe(folder, "ycbv") == "surrogate for YCB-Video, folder ycb"


def test_the_published_laval_has_all_objects(tmp_path: Path) -> None:
    for item in laval.OBJECTS:
        (tmp_path / f"{item}_occlusion_0").mkdir()
        (tmp_path / f"{item}_occlusion_0" / "poses.npy").touch()
    assert describe(tmp_path, "laval").startswith("Laval as published")
    (tmp_path / "dog_occlusion_0" / "poses.npy").unlink()
    assert describe(tmp_path, "laval").startswith("surrogate (in Laval's format")


def test_own_sequences_are_a_surrogate(tmp_path: Path) -> None:
    assert describe(tmp_path, "folders").startswith("surrogate (sequence folders")


def test_sequences_are_chosen_by_name(make_sequence: Callable[..., Any]) -> None:
    for name in ("easy_00", "easy_01"):
        made = make_sequence(name, frames=2)
    videos = read_sequences(made.folder.parent)
    assert choose(videos, None) == videos
    assert [video.name for video in choose(videos, ["easy_01"])] == ["easy_01"]
    with pytest.raises(InputError, match=r"no sequence hard_00.*there are easy_00, easy_01"):
        choose(videos, ["hard_00"])
