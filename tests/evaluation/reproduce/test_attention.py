"""Attention: measured on the object and beside it."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from moveit6d.config import ActionMode
from moveit6d.datasets.sequences import Sequence
from moveit6d.evaluation.reproduce import attention
from moveit6d.geometry.crop import Crop
from moveit6d.geometry.pose import Pose
from moveit6d.networks.policy_output import PolicyOutput
from moveit6d.observation import Observation
from moveit6d.policies import LoopState, OraclePolicy
from moveit6d.rendering.backends import make_renderer
from moveit6d.visualization.charts import Sheet


class Looking:
    """A policy whose attention is 1 on the left half of the patch."""

    mode = ActionMode.ALL_AXES
    crop: Crop = "look_at"

    def predict(self, seen: Observation, state: LoopState) -> PolicyOutput:
        attention = torch.zeros(len(seen), 1, 16, 16)
        attention[..., :8] = 1
        zero = torch.zeros(len(seen), 6)
        return PolicyOutput(torch.zeros(len(seen), 13), zero, torch.ones(len(seen)), attention)


def test_columns_have_names_of_their_own() -> None:
    files = [("a/early", 100), ("a/late", 200), ("b/early", 200), ("b/model", None)]
    files += [("a/own", None), ("b/own", None), ("c/early", 200)]
    found = attention.column_names([(Path(f"{name}.safetensors"), steps) for name, steps in files])
    assert found == [
        "100 steps", "200 steps (late)", "200 steps (early)", "model 2", "own", "own 2",
        "200 steps (early) 2",
    ]  # fmt: skip


def test_attention_is_measured_on_the_object_and_beside_it(video: Sequence) -> None:
    cases = attention.patches([video], 2, make_renderer())
    assert [case.name for case in cases] == ["easy_00, frame 0", "easy_00, frame 2"]
    found = attention.reproduction(
        cases, {"left": Looking(), "none": OraclePolicy(Pose.identity(1))}, "surrogate", {}
    )
    mask = cases[0].seen("look_at").mask[0, 0]
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


def test_a_network_sees_the_crop_that_it_was_trained_on(video: Sequence) -> None:
    class AxisParallel(Looking):
        crop: Crop = "axis_parallel"

        def predict(self, seen: Observation, state: LoopState) -> PolicyOutput:
            shown.append(seen)
            return super().predict(seen, state)

    shown: list[Observation] = []
    (case,) = attention.patches([video], 1, make_renderer())
    attention.reproduction([case], {"one": Looking(), "other": AxisParallel()}, "", {})
    (seen,) = shown
    assert torch.equal(seen.image, case.seen("axis_parallel").image)
    assert not torch.equal(seen.image, case.seen("look_at").image)
