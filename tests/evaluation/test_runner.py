"""Many sequences: what a tracker gets, what is written, and that nothing is done twice."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from PIL import Image

from moveit6d.config import CalibrationConfig, TrackerConfig
from moveit6d.datasets.pose_files import PoseRow, read_poses, write_poses
from moveit6d.datasets.sequences import Sequence, read_sequence, read_sequences
from moveit6d.errors import InputError
from moveit6d.estimation import PoseTracker
from moveit6d.estimation.states import TrackingState
from moveit6d.evaluation.protocols import NO_RESET, PAPER
from moveit6d.evaluation.run_tracker import TrackedFrame
from moveit6d.evaluation.runner import (
    Finished,
    Tracked,
    TrackJob,
    TrackStore,
    Workers,
    gather,
    run_all,
    track,
    tracker_and_frames,
)
from moveit6d.evaluation.sequence_scores import score_track
from moveit6d.geometry.pose import Pose
from moveit6d.io import write_json
from moveit6d.policies import OraclePolicy
from moveit6d.rendering.backends import make_renderer
from tests.support.configs import NO_CONTOUR
from tests.support.sequence_meshes import far_from_origin

Make = Callable[..., Any]
PLAIN = replace(NO_CONTOUR, calibration=CalibrationConfig(enabled=False))


class Truth(OraclePolicy):
    """Knows the poses of all frames; `next` moves on to another one."""

    def __init__(self, poses: list[Pose]) -> None:
        super().__init__(Pose.stack(poses[:1]))
        self.poses = poses

    def show(self, frame: int) -> None:
        """From now on this frame's pose is the goal."""
        self.truth = Pose.stack([self.poses[frame]])


def follow(
    made: Any, sequence: Sequence, config: TrackerConfig = PLAIN, **options: Any
) -> Iterator[TrackedFrame]:
    """A track by a policy that is shown the truth of each frame."""
    mesh = sequence.load_mesh()
    policy = Truth([mesh.inner(pose) for pose in made.poses])
    job = TrackJob(sequence=sequence, config=config, **options)
    policy.show(min(1, len(made.poses) - 1))
    for one in track(job, policy, make_renderer()):
        policy.show(min(one.frame.index + 1, len(made.poses) - 1))
        yield one


def test_a_sequence_is_followed_and_written(make_sequence: Make, tmp_path: Path) -> None:
    made = make_sequence(frames=5)
    (sequence,) = read_sequence(made.folder)
    path = tmp_path / "ours" / "easy_00.csv"
    rows = gather(sequence, follow(made, sequence), path)
    assert sorted(rows) == [0, 1, 2, 3, 4]
    assert rows[0].milliseconds is None, "the first pose is given"
    found = score_track(sequence, rows)
    assert found is not None and found.below_5 == 1.0 and found.frames == 4
    written = read_poses(path)
    assert len(written) == 5 and written[0].pose is not None
    torch.testing.assert_close(written[0].pose.translation, made.poses[0].translation)
    assert path.read_text().splitlines()[0].startswith("frame,r11,r12")


@pytest.mark.parametrize("damage", ["wrong size", "no image"])
def test_a_first_frame_that_cannot_calibrate_does_not_end_the_sequence(
    make_sequence: Make, damage: str
) -> None:
    made = make_sequence(frames=4)
    (sequence,) = read_sequence(made.folder)
    first = made.folder / "frames" / "000000.png"
    if damage == "wrong size":
        Image.new("RGB", (10, 10)).save(first)
    else:
        first.write_bytes(b"no picture")
    found = score_track(sequence, gather(sequence, follow(made, sequence, NO_CONTOUR), None))
    assert found is not None and found.below_5 == 1.0 and found.frames == 3


@pytest.mark.parametrize("enabled", [True, False])
def test_a_tracker_begins_and_calibrates_in_the_frame_of_the_start(
    make_sequence: Make, enabled: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    made, seen = make_sequence(frames=4), []
    (sequence,) = read_sequence(made.folder)
    later = replace(sequence, first=2, start=made.poses[2])
    config = replace(PLAIN, calibration=CalibrationConfig(enabled=enabled))
    monkeypatch.setattr(PoseTracker, "calibrate", lambda self, image: seen.append(image))
    policy = Truth([sequence.load_mesh().inner(made.poses[2])])
    job = TrackJob(sequence=later, config=config)
    _, frames = tracker_and_frames(job, policy, make_renderer())
    images = {frame.index: frame.image for frame in frames}
    assert sorted(images) == [2, 3]
    assert len(seen) == enabled and all(image is images[2] for image in seen)


def test_a_protocol_and_a_number_of_frames_are_kept(make_sequence: Make) -> None:
    made = make_sequence(frames=5)
    (sequence,) = read_sequence(made.folder)
    rows = gather(sequence, follow(made, sequence, protocol=PAPER, frames=2), None)
    assert sorted(rows) == [0, 1, 2] and rows[1].reset and not rows[2].reset


def test_without_a_path_nothing_is_written(make_sequence: Make, tmp_path: Path) -> None:
    made = make_sequence(frames=2)
    (sequence,) = read_sequence(made.folder)
    before = sorted(tmp_path.rglob("*"))
    assert sorted(gather(sequence, [], None)) == [0]
    assert sorted(tmp_path.rglob("*")) == before


@pytest.fixture
def jobs(make_sequence: Make) -> list[TrackJob]:
    """Two sequences that need no tracker here."""
    for name in ("easy_00", "hard_00"):
        made = make_sequence(name, frames=3)
    return [
        TrackJob(sequence=sequence, protocol=NO_RESET, settings={"weights": "a"})
        for sequence in read_sequences(made.folder.parent)
    ]


class Counting:
    """Stands for a tracker: every frame has the start pose; remembers what was done."""

    def __init__(self) -> None:
        self.done: list[str] = []

    def __call__(self, job: TrackJob, path: Path | None = None) -> Tracked:
        self.done.append(job.sequence.name)
        if job.sequence.name == "hard_00" and job.settings.get("bad"):
            raise InputError("the start is behind the camera.")
        frames = (
            TrackedFrame(frame, PoseRow(frame.index, pose=job.sequence.start))
            for frame in job.sequence.open()
            if frame.index > job.sequence.first
        )
        return Tracked(gather(job.sequence, frames, path))


def run(
    jobs: list[TrackJob], count: Counting, store: TrackStore | None = None, resume: bool = True
) -> list[Finished[TrackJob]]:
    return list(run_all(jobs, count, count, store=store, resume=resume))


def test_tracks_are_kept_and_used_again(jobs: list[TrackJob], tmp_path: Path) -> None:
    count, store = Counting(), TrackStore(tmp_path / "tracks")
    first = run(jobs, count, store)
    assert [done.kept for done in first] == [False, False]
    again = run(jobs, count, store)
    assert count.done == ["easy_00", "hard_00"] and all(done.kept for done in again)
    for one, two in zip(first, again, strict=True):
        assert one.tracked is not None and two.tracked is not None
        assert one.tracked.rows.keys() == two.tracked.rows.keys()
    run(jobs, count, store, resume=False)
    assert len(count.done) == 4


def test_the_track_of_a_mesh_far_from_its_origin_is_used_again(
    make_sequence: Make, tmp_path: Path
) -> None:
    made = make_sequence()
    poses = far_from_origin(made.folder)
    job, store = TrackJob(sequence=read_sequence(made.folder)[0]), TrackStore(tmp_path / "store")
    rows = {k: PoseRow(k, pose=pose) for k, pose in enumerate(poses)}
    write_poses(store.file(job), rows.values())
    store.finish(job, Tracked(rows), {})
    kept = store.read(job)
    assert kept is not None and list(kept.rows) == list(rows)


def test_other_settings_and_half_a_track_are_done_again(
    jobs: list[TrackJob], tmp_path: Path
) -> None:
    count, store = Counting(), TrackStore(tmp_path / "tracks")
    run(jobs, count, store)
    other = [replace(job, settings={"weights": "b"}) for job in jobs]
    assert [done.kept for done in run(other, count, store)] == [False, False]
    store.begin(other[1])  # as if it had been killed there
    assert [done.kept for done in run(other, count, store)] == [True, False]


def test_one_bad_sequence_does_not_stop_the_others(jobs: list[TrackJob], tmp_path: Path) -> None:
    bad = [replace(job, settings={"bad": True}) for job in jobs]
    store = TrackStore(tmp_path / "tracks")
    easy, hard = run(list(reversed(bad)), Counting(), store)[::-1]
    assert easy.tracked is not None and hard.tracked is None
    assert hard.error == "the start is behind the camera."
    assert not store.file(bad[1], ".json").exists()


@pytest.mark.parametrize("workers", [Workers(), Workers(jobs=2)], ids=["here", "elsewhere"])
def test_a_sequence_that_fails_leaves_no_older_track(
    jobs: list[TrackJob], tmp_path: Path, workers: Workers
) -> None:
    store, bad = TrackStore(tmp_path / "tracks"), replace(jobs[1], settings={"bad": True})
    run([jobs[1]], Counting(), store)
    assert store.file(bad).exists()
    (done,) = run_all([bad], Counting(), Counting(), store=store, workers=workers)
    assert done.error and not store.file(bad).exists()


def test_starting_again_keeps_whole_tracks_until_their_turn(
    jobs: list[TrackJob], tmp_path: Path
) -> None:
    store = TrackStore(tmp_path / "tracks")
    run(jobs, Counting(), store)

    def stop(job: TrackJob, path: Path | None = None) -> Tracked:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        list(run_all(jobs, stop, stop, store=store))
    assert [store.file(job, ".json").exists() for job in jobs] == [False, True]


def test_a_track_that_is_read_back_has_its_states_and_failures(
    jobs: list[TrackJob], tmp_path: Path
) -> None:
    store, state = TrackStore(tmp_path / "tracks"), str(TrackingState.UNCERTAIN)

    def uncertain(job: TrackJob, path: Path | None = None) -> Tracked:
        frame = next(iter(job.sequence.open()))
        row = PoseRow(1, pose=job.sequence.start, confidence=0.9, state=state)
        rows = gather(job.sequence, [TrackedFrame(frame, row)], path)
        return Tracked(rows, failures={2: "2.png is damaged."})

    list(run_all(jobs, uncertain, uncertain, store=store))
    kept = store.read(jobs[0])
    assert kept is not None and kept.rows[1].state == state
    assert kept.failures == {2: "2.png is damaged."}
    mark = store.file(jobs[0], ".json")
    write_json(mark, {"settings": dict(jobs[0].settings), "failures": [3]})
    with pytest.raises(InputError, match="cannot be read"):
        store.read(jobs[0])
