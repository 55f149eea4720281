"""`moveit6d demo` makes a clip, tracks it, and says the error; the tracker here never moves."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from moveit6d.actions import ActionSpace
from moveit6d.cli.demo import verdict
from moveit6d.cli.main import main
from moveit6d.config import ActionMode
from moveit6d.datasets.pose_files import read_poses
from moveit6d.datasets.sequences import read_sequences
from moveit6d.evaluation.track_scores import Score
from moveit6d.geometry.crop import Crop
from moveit6d.networks.policy_output import PolicyOutput
from moveit6d.observation import Observation
from moveit6d.policies import LoopState


class Stay:
    """Stops at once."""

    mode = ActionMode.SINGLE
    crop: Crop = "look_at"

    def predict(self, seen: Observation, state: LoopState) -> PolicyOutput:
        count = len(state.sphere_diameter)
        stop = torch.full((count,), int(ActionSpace.STOP))
        logits = torch.nn.functional.one_hot(stop, 13).double()
        return PolicyOutput(logits, torch.zeros(count, 6, dtype=torch.float64), torch.ones(count))


@pytest.fixture(autouse=True)
def stay(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("moveit6d.policies.load_policy", lambda *_, **__: Stay())


def test_demo_end_to_end(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    output = tmp_path / "demo"
    assert main(["demo", "--output", str(output), "--frames", "3", "--difficulty", "easy"]) == 0
    said = capsys.readouterr().out
    assert "error against the true poses (ADD): mean" in said
    assert "below 10 % of the diameter (222 mm): 100.0 % of 2 frames" in said
    assert len(read_poses(output / "track" / "poses.csv")) == 3
    assert (output / "track" / "overlay.mp4").stat().st_size > 1000
    (sequence,) = read_sequences(output / "sequence")
    assert len(sequence.truth) == 3


def test_demo_can_be_repeated_without_overlay(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for _ in range(2):
        command = ["demo", "--output", str(tmp_path), "--frames", "2", "--no_overlay"]
        assert main(command) == 0
    assert "overlay" not in capsys.readouterr().out
    assert not (tmp_path / "track" / "overlay.mp4").exists()


def test_verdict_says_when_the_track_was_lost() -> None:
    score = Score(
        frames=119,
        below_10=0.5,
        below_5=0.4,
        mean_add=0.02,
        median_add=0.01,
        until_lost=60,
        within_5cm_5deg=0.5,
        resets=0,
        milliseconds=20.0,
        missing=0,
    )
    assert verdict(score, 0.222).splitlines() == [
        "error against the true poses (ADD): mean 20.0 mm, median 10.0 mm",
        "below 10 % of the diameter (222 mm): 50.0 % of 119 frames; followed until frame 60",
    ]
