"""Detection: scored by both criteria, truth only for judging."""

from __future__ import annotations

import numpy as np
import pytest

from moveit6d.config import ActionMode
from moveit6d.datasets.sequences import Sequence
from moveit6d.estimation import SeedDetector, SeedDetectorConfig, SelectionCriterion
from moveit6d.evaluation.reproduce import detection
from moveit6d.geometry.pose import Pose
from moveit6d.policies import OraclePolicy
from moveit6d.visualization.charts import Sheet


def a_detector(video: Sequence) -> SeedDetector:
    mesh = video.load_mesh()
    policy = OraclePolicy(Pose.stack([mesh.inner(video.start)] * 32), ActionMode.ALL_AXES)
    config = SeedDetectorConfig(sizes=(0.4,), poses=1, sinks=1, rotations=2)
    return SeedDetector(mesh, video.camera, config=config, policy=policy)


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
