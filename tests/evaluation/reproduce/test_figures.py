"""Runtime, attention and detection: figures in their places, truth only for judging."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch

from moveit6d.config import ActionMode
from moveit6d.datasets.sequences import Sequence, read_sequences
from moveit6d.estimation import PoseDetector, SeedDetectorConfig, SelectionCriterion
from moveit6d.evaluation.iteration_timing import IterationTimes
from moveit6d.evaluation.reproduce import attention, detection, runtime
from moveit6d.evaluation.reproduce.tracks import ScoredTrack
from moveit6d.geometry.crop import Crop
from moveit6d.geometry.pose import Pose
from moveit6d.networks.policy_output import PolicyOutput
from moveit6d.observation import Observation
from moveit6d.policies import LoopState, OraclePolicy
from moveit6d.rendering.backends import make_renderer
from moveit6d.visualization.charts import Sheet


@pytest.fixture
def video(make_sequence: Callable[..., Any]) -> Sequence:
    return read_sequences(make_sequence("easy_00", frames=3, still=True).folder)[0]


def test_runtime_stands_beside_the_paper_without_rendering(video: Sequence) -> None:
    parts = {"crop": 2.0, "render": 3.0, "observe": 0.5, "network": 11.0, "move": 1.0}
    truth = Pose.identity(4)
    track = ScoredTrack(video, (1, 2, 3, 4), truth, truth, 0, (2, 2, 3, 3), (40.0,) * 4)
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


class Looking:
    """A policy whose attention is 1 on the left half of the patch."""

    mode = ActionMode.ALL_AXES
    crop: Crop = "look_at"

    def predict(self, seen: Observation, state: LoopState) -> PolicyOutput:
        attention = torch.zeros(len(seen), 1, 16, 16)
        attention[..., :8] = 1
        zero = torch.zeros(len(seen), 6)
        return PolicyOutput(torch.zeros(len(seen), 13), zero, torch.ones(len(seen)), attention)


def test_attention_is_measured_on_the_object_and_beside_it(video: Sequence) -> None:
    cases = attention.patches([video], 2, make_renderer())
    assert [case.name for case in cases] == ["easy_00, frame 0", "easy_00, frame 2"]
    found = attention.reproduction(
        cases, {"left": Looking(), "none": OraclePolicy(Pose.identity(1))}, "surrogate", {}
    )
    mask = cases[0].seen.mask[0, 0]
    cell = mask.reshape(16, 8, 16, 8).mean((1, 3))
    row = found.tables[0].rows[0]
    assert row[2] == pytest.approx(float(cell[:, :8].sum() / cell.sum()), abs=1e-5)
    assert row[3] == pytest.approx(float((1 - cell)[:, :8].sum() / (1 - cell).sum()), abs=1e-5)
    assert row[4] == pytest.approx(100 * float(cell[:, :8].mean()), abs=1e-3)
    assert found.tables[0].rows[1][2:] == (None, None, None)
    sheet = found.charts[0]
    assert isinstance(sheet, Sheet) and sheet.columns == 4 and len(sheet.panels) == 8
    picture = sheet.panels[2].picture
    assert picture is not None and picture[:, :64].min() == 1 and picture[:, 64:].max() == 0


def a_detector(video: Sequence) -> PoseDetector:
    mesh = video.load_mesh()
    policy = OraclePolicy(Pose.stack([mesh.inner(video.start)] * 32), ActionMode.ALL_AXES)
    config = SeedDetectorConfig(sizes=(0.4,), poses=1, sinks=1, rotations=2)
    return PoseDetector(mesh, video.camera, config=config, policy=policy)


def test_detection_is_scored_by_both_criteria(video: Sequence) -> None:
    detector = a_detector(video)
    ((trial, image, found),) = detection.run([video], {video.name: detector}, 1)
    assert trial.rank == 1 and trial.size == pytest.approx(1, abs=0.7)
    assert max(trial.add.values()) < 1e-6 and trial.best < 1e-6 and trial.seconds > 0
    assert set(trial.rotation) == set(SelectionCriterion)
    iterations, ways = detection.turned_starts(detector, image, video.truth[0], (-9.0, 0.0, 9.0))
    assert iterations[1] < iterations[0] == iterations[2]
    np.testing.assert_allclose(ways, (9, 0, 9), atol=1e-6)
    example = detection.Example(image, found, (-9.0, 0.0, 9.0), iterations, ways)
    reproduction = detection.reproduction([trial], example, "surrogate", {})
    summary = dict(row[:2] for row in reproduction.tables[0].rows)
    assert summary["ADD < 10 % d, criterion iterations, %"] == 100
    assert summary["object is the strongest sink, %"] == 100
    sheet = reproduction.charts[0]
    assert isinstance(sheet, Sheet)
    arrows, cross = sheet.panels[0].arrows, sheet.panels[1].crosses["centre"]
    assert arrows is not None and len(arrows) == found.fields[0].sink.numel()
    rows, columns = found.fields[0].sink.shape
    assert -0.5 <= cross[0] <= columns and -0.5 <= cross[1] <= rows


def test_an_object_that_no_sink_belongs_to_is_said(video: Sequence) -> None:
    trial = detection.DetectionTrial(
        "v",
        3,
        None,
        None,
        dict.fromkeys(SelectionCriterion, float("inf")),
        dict.fromkeys(SelectionCriterion, 180.0),
        float("inf"),
        1.0,
    )
    detector = a_detector(video)
    example = detection.Example(
        np.zeros((120, 160, 3), np.uint8),
        detector.detect(np.zeros((120, 160, 3), np.uint8)),
        (0.0,),
        (1.0,),
        (float("nan"),),
    )
    found = detection.reproduction([trial], example, "surrogate", {})
    assert found.tables[1].rows[0][2:6] == (None, None, None, None)
    summary = dict(row[:2] for row in found.tables[0].rows)
    assert summary["best size tried there / true size, mean"] is None
