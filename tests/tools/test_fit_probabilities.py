"""The regression finds the weights that made the data."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from moveit6d.errors import InputError
from moveit6d.estimation import StopReason, Target, TrackingResult
from moveit6d.geometry.camera import Camera
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.networks.compact import CompactConfig, CompactCorrelationNet
from moveit6d.networks.inference import InferenceNetwork
from moveit6d.networks.weights_file import load_network, save_network
from moveit6d.parallel import JobResult
from moveit6d.policies import NetworkPolicy
from moveit6d.rendering.backends import make_renderer
from tests.support.observations import an_observation


@pytest.fixture(scope="module")
def tool() -> ModuleType:
    path = Path(__file__).parents[2] / "tools" / "fit_probabilities.py"
    spec = importlib.util.spec_from_file_location("fit_probabilities", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    import sys

    sys.modules["fit_probabilities"] = module
    spec.loader.exec_module(module)
    return module


def test_the_weights_come_back(tool: Any) -> None:
    random = np.random.default_rng(0)
    values = random.random((20000, 2))
    true = np.array([9.0, 4.0, -7.0])
    right = random.random(len(values)) < tool.probability(true, values)
    np.testing.assert_allclose(tool.fit(values, right), true, atol=0.4)


def test_borderline_poses_teach_nothing(tool: Any, capsys: Any) -> None:
    errors = (0.05, 0.12, 0.2, float("inf"))
    found = [tool.Example((0.5, 0.5), error, "x") for error in errors]
    assert [one.borderline for one in found] == [False, True, False, False]
    assert [one.right for one in found] == [True, False, False, False]
    examples = [
        tool.Example((a, a), 0.05 if a > 0.5 else 0.3, name)
        for name in "xy"
        for a in np.linspace(0, 1, 40)
    ]
    kept = tool.without_borderline([*examples, found[1]])
    tool.report("VerificationConfig", ("confidence", "similarity"), kept)
    assert "80 poses, 50% right" in capsys.readouterr().out


def test_a_calibrated_network_says_what_the_line_says(
    tool: Any, tmp_path: Any, capsys: Any
) -> None:
    random = np.random.default_rng(0)
    said = random.random(4000)
    examples = [
        # Right less often than said: by the square of it.
        tool.Example((c, 0.3), 0.05 if random.random() < c * c else 0.3, "x")
        for c in said
    ]
    line = tool.platt(examples)
    better = tool.calibrated(examples, line)
    assert abs(np.mean([one.evidence[0] for one in better]) - 1 / 3) < 0.03
    torch.manual_seed(0)
    save_network(CompactCorrelationNet(), tmp_path / "before.safetensors", {"steps": "7"})
    tool.write_calibrated(tmp_path / "before.safetensors", line, tmp_path / "after.safetensors")
    before, after = (load_network(tmp_path / f"{name}.safetensors") for name in ("before", "after"))
    assert after.facts["steps"] == "7"
    seen = an_observation(3)
    one, other = (
        InferenceNetwork(loaded.network, compute="float32")(seen) for loaded in (before, after)
    )
    expected = tool.probability(line, tool.logit(one.confidence.double().numpy())[:, None])
    np.testing.assert_allclose(other.confidence.numpy(), expected, atol=1e-5)
    torch.testing.assert_close(one.delta, other.delta)


def test_both_confidences_of_single_images_are_asked(tool: Any, brick: Mesh) -> None:
    torch.manual_seed(0)
    image = np.random.default_rng(0).integers(0, 255, (240, 320, 3), np.uint8)
    pose, camera = (
        Pose.from_rvec([0, 0, 0.2], [0, 0, 0.7]),
        Camera(300, 300, 159.5, 119.5, 320, 240),
    )
    target, renderer = Target(image, camera, brick, pose), make_renderer()
    result = TrackingResult(pose, 1, StopReason.STOP_ACTION, 0.4, 1.0)
    plain, headed = (
        CompactCorrelationNet(CompactConfig(search_head=head)) for head in (False, True)
    )
    assert tool.said_for_searches(target, result, NetworkPolicy(plain), renderer) == 0.5
    torch.nn.init.constant_(headed.search_head[-1].weight, 0.0)
    torch.nn.init.constant_(headed.search_head[-1].bias, 2.0)
    said = tool.said_for_searches(target, result, NetworkPolicy(headed), renderer)
    assert said == pytest.approx(1 / (1 + np.exp(-2.0)), abs=1e-3)


def test_what_is_known_to_be_there_raises_all_log_odds_alike(tool: Any, capsys: Any) -> None:
    random = np.random.default_rng(0)
    values, weights = random.random((20000, 2)), np.array([3.0, 2.0, -4.0])
    right = random.random(len(values)) < tool.probability(weights + [0, 0, 1.5], values)
    assert tool.shift(weights, values, right) == pytest.approx(1.5, abs=0.1)
    examples = [
        tool.Example(tuple(row), 0.05 if one else 0.3, "x")
        for row, one in zip(values.tolist(), right.tolist(), strict=True)
    ]
    tool.report_present(weights, examples)
    assert "present 1.5" in capsys.readouterr().out


@pytest.mark.parametrize("head", [False, True])
def test_what_a_search_head_says_is_not_calibrated_with_the_line_of_another(
    tool: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, head: bool
) -> None:
    """Detections ask the search head, if there is one, which `--calibrated` leaves as it is."""
    weights = tmp_path / "weights.safetensors"
    save_network(CompactCorrelationNet(CompactConfig(search_head=head)), weights)
    random = np.random.default_rng(0)
    kinds = [
        [tool.Example((c, 0.3), 0.05 if random.random() < c * c else 0.3, "x") for c in said]
        for said in random.random((5, 400))
    ]
    told: dict[str, Any] = {}
    held_out = SimpleNamespace(mesh_paths=lambda: ((), [weights]))
    monkeypatch.setattr(tool, "data_of", lambda _: held_out)
    monkeypatch.setattr(tool, "check_held_out", lambda _: None)
    monkeypatch.setattr(tool, "run_jobs", lambda *_, **__: [JobResult(0, kinds)])
    monkeypatch.setattr(tool, "report", lambda name, _, examples: told.update({name: examples}))
    monkeypatch.setattr(tool, "report_present", lambda _, examples: told.update(present=examples))
    given = ["--meshes", "none", "--photos", "none", "--weights", str(weights)]
    tool.main([*given, "--calibrated", str(tmp_path / "calibrated.safetensors")])
    found, followed, _, present, uncoloured = kinds
    assert (told["VerificationConfig"] == tool.in_log_odds(found)) is head
    assert (told["present"] == tool.in_log_odds(present)) is head
    assert told["StateConfig"] != followed, "tracks ask the confidence that is calibrated"
    assert told["StateConfig, uncoloured"] != tool.in_log_odds(uncoloured), "all of them do"


def test_without_examples_it_says_so(
    tool: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    for name in ("a.glb", "b.glb", "c.glb"):
        (tmp_path / name).touch()
    given = ["--meshes", str(tmp_path), "--photos", str(tmp_path)]
    with pytest.raises(InputError, match=r"data\.holdout is 1, .* 2 or more"):
        tool.main([*given, "--holdout", "1"])
    monkeypatch.setattr(tool, "run_jobs", lambda *_, **__: [JobResult(0, None, "it is too large")])
    with pytest.raises(InputError, match="no examples"):
        tool.main([*given, "--holdout", "2", "--mesh_unit", "mm"])
    assert "a.glb teaches nothing: it is too large" in capsys.readouterr().out
    none: list[list[Any]] = [[], [], [], [], []]
    monkeypatch.setattr(tool, "run_jobs", lambda *_, **__: [JobResult(0, none)])
    assert tool.main([*given, "--holdout", "2"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 5 and all("no examples" in line for line in lines)
