"""The runtime table: beside the paper's, without rendering."""

from __future__ import annotations

from dataclasses import replace

from moveit6d.datasets.sequences import Sequence
from moveit6d.evaluation.iteration_timing import IterationTimes
from moveit6d.evaluation.reproduce import runtime
from moveit6d.evaluation.reproduce.tracks import ScoredTrack
from moveit6d.geometry.pose import Pose


def test_runtime_stands_beside_the_paper_without_rendering(video: Sequence) -> None:
    parts = {"crop": 2.0, "render": 3.0, "observe": 0.5, "network": 11.0, "move": 1.0}
    truth = Pose.identity(4)
    track = ScoredTrack(video, (1, 2, 3, 4), truth, truth, (2, 2, 3, 3), (40.0,) * 4)
    found = runtime.reproduction(IterationTimes(parts, 17.5, 18.0), [track], "surrogate", {})
    iteration = {row[0]: row[1:] for row in found.tables[0].rows}
    assert iteration["image preprocessing (crop, resize)"] == (2.5, 14.6)
    assert iteration["iteration without rendering"] == (14.5, 19.8)
    assert iteration["network"] == (11.0, 5.2) and iteration["whole iteration, rendering too"] == (
        18.0,
        None,
    )
    frames = {row[0]: row[1:] for row in found.tables[1].rows}
    assert frames["all frames"] == (4, 2.5, 2.5 * 14.5, 40.0)
    assert frames["paper (YCB-Video)"] == (None, 4.2, 83.16, None)
    assert (
        len(runtime.reproduction(IterationTimes(parts, 17.5, 18.0), [], "surrogate", {}).tables)
        == 1
    )


def test_frames_that_nobody_counted_are_not_averaged(video: Sequence) -> None:
    parts = dict.fromkeys(("crop", "render", "observe", "network", "move"), 1.0)
    truth = Pose.identity(2)
    some = ScoredTrack(video, (1, 2), truth, truth, (3, None), (40.0, None))
    none = ScoredTrack(replace(video, name="dark"), (1, 2), truth, truth, (None,) * 2, (None,) * 2)
    found = runtime.reproduction(IterationTimes(parts, 5.0, 5.0), [some, none], "", {})
    frames = {row[0]: row[1:] for row in found.tables[1].rows}
    assert frames["easy_00"] == (2, 3.0, 12.0, 40.0) and frames["dark"] == (2, None, None, None)
    assert frames["all frames"] == (4, 3.0, 12.0, 40.0)
