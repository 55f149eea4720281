"""Tracks among results: by file, by object and by image."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from moveit6d.datasets.pose_files import POSE_COLUMNS, PoseRow, read_poses, write_poses
from moveit6d.datasets.sequences import Sequence, read_sequence, read_sequences
from moveit6d.errors import InputError
from moveit6d.evaluation.sequence_scores import gaps, score_results, scored_truth
from moveit6d.evaluation.track_files import read_tracks

Make = Callable[..., Any]


@pytest.fixture
def two(make_sequence: Make) -> list[Sequence]:
    """A clip with two objects that are one and the same brick."""
    return two_objects(make_sequence("two").folder)


def two_objects(folder: Path) -> list[Sequence]:
    """The sequences of a folder once its brick is a cup and a plate."""
    rows = [
        replace(row, object=name)
        for row in read_poses(folder / "poses.csv")
        for name in ("cup", "plate")
    ]
    write_poses(folder / "poses.csv", rows, ("frame", "image", "object", *POSE_COLUMNS))
    for name in ("cup", "plate"):
        shutil.copy(folder / "mesh.ply", folder / f"{name}.ply")
    return read_sequences(folder)


def track(sequence: Sequence, first: int = 0, object: str = "") -> list[PoseRow]:
    """A right track of the later frames, numbered from 0 as in a folder of their own."""
    frames = sorted(sequence.truth)[first:]
    names = sequence.image_names
    return [
        PoseRow(k, f"{names[frame]}.png", sequence.truth[frame], object=object)
        for k, frame in enumerate(frames)
    ]


def test_a_track_of_the_later_frames_is_scored_by_its_images(
    make_sequence: Make, tmp_path: Path
) -> None:
    (sequence,) = read_sequence(make_sequence(frames=8).folder)
    file = tmp_path / "poses.csv"
    write_poses(file, track(sequence, first=3))
    ((_, rows),) = read_tracks([sequence], file)
    assert list(rows) == [3, 4, 5, 6, 7]
    score = score_results([sequence], file)["easy_00"]
    assert score.frames == 4 and score.below_5 == 1.0 and score.missing == 0
    assert list(scored_truth(sequence, rows)) == list(rows)
    assert gaps(sequence, rows) == [
        "its track begins with frame 3; the frames before are not scored"
    ]


def test_rows_without_images_go_by_their_numbers(make_sequence: Make, tmp_path: Path) -> None:
    """A benchmark's results, whose missing rows count as wrong."""
    (sequence,) = read_sequence(make_sequence().folder)
    for name in ("", "clip.mp4#000000", "camera0#000000"):
        rows = [PoseRow(k, name, sequence.truth[k]) for k in (0, 2, 3)]
        write_poses(tmp_path / "poses.csv", rows)
        ((_, found),) = read_tracks([sequence], tmp_path)
        assert list(found) == [0, 2, 3]
        score = score_results([sequence], tmp_path)["easy_00"]
        assert score.frames == 5 and score.missing == 3
        assert gaps(sequence, found) == [
            "3 of 5 frames have no row in its track and count as wrong"
        ]
    late = [PoseRow(k, "", sequence.truth[k]) for k in (2, 3)]
    write_poses(tmp_path / "poses.csv", late)
    assert score_results([sequence], tmp_path)["easy_00"].missing == 3


def test_images_of_another_video_are_refused(make_sequence: Make, tmp_path: Path) -> None:
    (sequence,) = read_sequence(make_sequence().folder)
    write_poses(tmp_path / "poses.csv", [PoseRow(0, "other_000000.png", sequence.start)])
    with pytest.raises(InputError, match=r"other_000000\.png is not among the frames, 000000 to"):
        score_results([sequence], tmp_path)


@pytest.mark.parametrize("place", ["poses.csv", "two.csv", "two/poses.csv"])
def test_one_table_of_two_objects(two: list[Sequence], tmp_path: Path, place: str) -> None:
    cup, plate = two
    rows = [*track(cup, object="cup"), *[PoseRow(k, object="plate") for k in range(6)]]
    write_poses(tmp_path / "out" / place, rows)
    wanted = {"two.cup": 1.0, "two.plate": 0.0}
    found = score_results(two, tmp_path / "out")
    assert {name: score.below_5 for name, score in found.items()} == wanted
    if place == "poses.csv":
        assert score_results(two, tmp_path / "out" / place).keys() == wanted.keys()
    write_poses(tmp_path / "out" / place, track(cup, object="cup"))
    assert list(score_results(two, tmp_path / "out")) == ["two.cup"]


def test_a_file_of_its_own_needs_no_names(two: list[Sequence], tmp_path: Path) -> None:
    write_poses(tmp_path / "two.plate.csv", track(two[1]))
    assert list(score_results(two, tmp_path)) == ["two.plate"]


def test_a_table_that_does_not_tell_the_objects_is_refused(
    two: list[Sequence], make_sequence: Make, tmp_path: Path
) -> None:
    file = tmp_path / "poses.csv"
    write_poses(file, track(two[0]))
    with pytest.raises(InputError, match=r"does not say of which object .* as cup, or .*two\.cup"):
        score_results(two, tmp_path)
    write_poses(file, track(two[0], object="mug"))
    with pytest.raises(InputError, match=r"tracks of mug; .* must be called cup and plate"):
        score_results(two, file)
    both = [row for name in ("cup", "plate") for row in track(two[0], object=name)]
    write_poses(file, both)
    with pytest.raises(InputError, match="tracks of cup, plate, but easy_00 is of one object"):
        score_results(read_sequence(make_sequence().folder), file)
