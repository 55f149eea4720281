"""Both confidences make one probability, and no pose changes."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest
import torch

from moveit6d.config import ActionMode, LoopConfig, SingleImageConfig, TrackerConfig
from moveit6d.estimation.final_confidence import (
    probability,
    search_confidences,
    with_both_confidences,
)
from moveit6d.estimation.refine import refine_starts
from moveit6d.estimation.results import Refined, Start
from moveit6d.frame import prepare_frame
from moveit6d.geometry.camera import Camera
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.networks.compact import CompactConfig, CompactCorrelationNet
from moveit6d.policies import NetworkPolicy, OraclePolicy, Policy
from moveit6d.rendering.backends import make_renderer

CAMERA = Camera(300, 300, 159.5, 119.5, 320, 240)
CONFIG = TrackerConfig(loop=LoopConfig(max_iterations=2))
RENDERER = make_renderer()


def starts_at(brick: Mesh) -> list[Start]:
    image = np.random.default_rng(0).integers(0, 255, (240, 320, 3), np.uint8)
    frame = prepare_frame(image, CAMERA)
    poses = [Pose.from_rvec([0.1, k, 0.2], [0.01, 0, 0.7]) for k in (0, 1)]
    return [Start(frame, brick, pose.to(torch.float64)) for pose in poses]


def network(search_head: bool) -> NetworkPolicy:
    torch.manual_seed(0)
    net = CompactCorrelationNet(CompactConfig(search_head=search_head)).eval()
    if search_head:
        torch.nn.init.constant_(net.search_head[-1].bias, 1.5)  # says more than the other
    return NetworkPolicy(net, compute="float32")


def refined(starts: list[Start], policy: Policy) -> list[Refined]:
    return refine_starts(starts, policy=policy, renderer=RENDERER, loop=CONFIG.loop)


def test_the_confidence_is_the_regression_of_both(brick: Mesh) -> None:
    policy, starts = network(search_head=True), starts_at(brick)
    before = [
        *refined(starts, policy),
        Refined(None, 0, refined(starts, policy)[0].stopped_by, 0.3, 0),
    ]
    tools = {"policy": policy, "renderer": RENDERER}
    after = with_both_confidences([*starts, starts[0]], before, config=CONFIG, **tools)
    said = search_confidences([*starts, starts[0]], before, loop=CONFIG.loop, **tools)
    assert sorted(said) == [0, 1], "what has no pose is not asked for"
    assert after[2] == before[2]
    weights = CONFIG.single_image
    for k in (0, 1):
        odds = [np.log(p / (1 - p)) for p in (before[k].confidence, said[k].confidence)]
        total = np.dot(odds, (weights.confidence, weights.search_confidence)) + weights.intercept
        assert after[k].confidence == pytest.approx(1 / (1 + np.exp(-total)), abs=1e-6)
        assert said[k].confidence != pytest.approx(before[k].confidence, abs=0.01)
        changed = {
            field.name
            for field in fields(Refined)
            if getattr(after[k], field.name) is not getattr(before[k], field.name)
        }
        assert changed == {"confidence", "milliseconds"}


@pytest.mark.parametrize("kind", ["no head", "oracle", "single"])
def test_policies_without_a_confidence_for_searches_stay_as_they_are(
    brick: Mesh, kind: str
) -> None:
    starts, config = starts_at(brick), CONFIG
    policy: Policy = network(search_head=kind == "single")
    if kind == "oracle":
        policy = OraclePolicy(Pose.stack([one.centred for one in starts]), ActionMode.ALL_AXES)
    results = refined(starts, policy)
    if kind == "single":
        config = TrackerConfig(loop=LoopConfig(mode="single"))
    found = with_both_confidences(starts, results, policy=policy, renderer=RENDERER, config=config)
    assert found == results


def test_a_weight_of_one_alone_is_that_confidence() -> None:
    for value in (0.02, 0.5, 0.97):
        assert probability(SingleImageConfig(1, 0, 0), value, 0.9) == pytest.approx(value)
        assert probability(SingleImageConfig(0, 1, 0), 0.9, value) == pytest.approx(value)
    assert (
        0 < probability(SingleImageConfig(), 0.0, 0.0) < probability(SingleImageConfig(), 1, 1) < 1
    )
