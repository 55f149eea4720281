"""Configurations are plain data, documented field by field, and refuse what cannot be right."""

from __future__ import annotations

import dataclasses
import json
import math
import subprocess
import sys
from typing import Any

import pytest

from moveit6d.cli.settings import argument_texts
from moveit6d.config import (
    PAPER_CONFIG,
    CalibrationConfig,
    ContourConfig,
    DetectorConfig,
    KeyframeConfig,
    LoopConfig,
    MatchConfig,
    MotionConfig,
    MultiStartConfig,
    PerturbationConfig,
    RecoveryConfig,
    RegionConfig,
    SeedDetectorConfig,
    StateConfig,
    TemplateConfig,
    TextureConfig,
    TrackerConfig,
    VerificationConfig,
)
from moveit6d.errors import InputError

KINDS = (
    TrackerConfig, LoopConfig, MultiStartConfig, PerturbationConfig, MotionConfig, ContourConfig,
    CalibrationConfig, SeedDetectorConfig, TemplateConfig, MatchConfig, VerificationConfig,
    DetectorConfig, StateConfig, RecoveryConfig, RegionConfig, TextureConfig, KeyframeConfig,
)  # fmt: skip


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_every_field_is_documented(kind: type) -> None:
    names = [field.name for field in dataclasses.fields(kind)]  # type: ignore[arg-type]
    texts = argument_texts(kind)
    assert sorted(texts) == sorted(names)
    assert all(len(text) > 8 for text in texts.values())


def test_a_configuration_is_plain_data() -> None:
    values = json.loads(json.dumps(TrackerConfig().as_dict()))
    assert values["loop"]["fine_scale"] == 1.6 and values["contour"]["scales"] == [[2, 2], [1, 1]]
    assert TrackerConfig() == TrackerConfig() and hash(TrackerConfig()) == hash(TrackerConfig())


def test_the_paper_has_nothing_beyond_the_paper() -> None:
    paper = PAPER_CONFIG
    assert paper.loop.mode == "single" and not paper.loop.fine_stage and not paper.loop.augment
    assert not (paper.multi_start.enabled or paper.contour.enabled or paper.calibration.enabled)
    assert not paper.recovery.enabled


@pytest.mark.parametrize(
    ("kind", "given", "message"),
    [
        (TrackerConfig, {"low_confidence": 0.9}, "low_confidence ≤ high_confidence"),
        (TextureConfig, {"pieces": 0}, "pieces must be 1 or more"),
        (MultiStartConfig, {"below": 1.5}, "below must be a confidence, found 1.5"),
        (MultiStartConfig, {"recovery_every": 0}, "recovery_every must be 1 or more, found 0"),
        (MultiStartConfig, {"batch_size": 0}, "batch_size must be 1 or more, found 0"),
        (MultiStartConfig, {"rounds": -1}, "rounds must be 0 or more, found -1"),
        (PerturbationConfig, {"count": -1}, "count must be 0 or more, found -1"),
        (PerturbationConfig, {"shift": (0.0, math.inf, 0.0)}, "shift must be 0 or more and finite"),
        (PerturbationConfig, {"rotation": (20.0, 5.0)}, "the smaller first"),
        (MotionConfig, {"velocity_decay": 1.0}, "velocity_decay must be 0 or more and below 1"),
        (MotionConfig, {"velocity_rate": 2.0}, "velocity_rate must be from 0 to 1, found 2.0"),
        (MotionConfig, {"slow_delta": math.nan}, "slow_delta must be 0 or more, found nan"),
        (ContourConfig, {"scales": ()}, r"scales must be .*, found \(\)"),
        (ContourConfig, {"scales": ((2,), ())}, "scales must be one or more lists"),
        (ContourConfig, {"scales": ((0,),)}, "each 1 or more"),
        (ContourConfig, {"bins": 0}, "bins must be from 1 to 256, found 0"),
        (ContourConfig, {"normal_blur": 0.0}, "normal_blur must be above 0 and finite, found 0.0"),
        (ContourConfig, {"lines": -3}, "lines must be 1 or more, found -3"),
        (ContourConfig, {"window": 0}, "window must be 1 or more, found 0"),
        (ContourConfig, {"prior": (1.0, 1.0, 1.0, 1.0, 1.0, 0.0)}, "prior must be above 0"),
        (ContourConfig, {"pixel_error": 0.0}, "pixel_error must be above 0 and below 0.5"),
        (ContourConfig, {"amplitude": 0.6}, "amplitude must be from 0 to 0.5, found 0.6"),
        (ContourConfig, {"min_pixels": 0}, "min_pixels must be 1 or more, found 0"),
        (CalibrationConfig, {"pairs": -1}, "pairs must be 0 or more, found -1"),
        (CalibrationConfig, {"share": 1.5}, "share must be from 0 to 1, found 1.5"),
        (CalibrationConfig, {"max_bias": -1.0}, "max_bias must be 0 or more, found -1.0"),
    ],
)
def test_what_cannot_be_right_is_refused(kind: type, given: dict[str, Any], message: str) -> None:
    needed = {"count": 1, "shift": (1.0, 1.0, 1.0), "rotation": (0.0, 5.0)}
    rest = needed if kind is PerturbationConfig else {}
    with pytest.raises(InputError, match=f"{kind.__name__}: .*{message}"):
        kind(**rest | given)


def test_what_lies_at_the_edge_is_taken() -> None:
    assert PerturbationConfig(0, (0.0, 0.0, 0.0), (0.0, 0.0)).count == 0
    assert MotionConfig(slow_delta=0.0, velocity_rate=1.0, velocity_decay=0.0).slow_delta == 0
    assert ContourConfig(max_delta=math.inf, moves_below=1.1, bins=256, amplitude=0.5).bins == 256
    assert MultiStartConfig(rounds=0, recovery_first=0).rounds == 0
    assert CalibrationConfig(pairs=0, disagreement=math.inf).pairs == 0


def test_the_module_needs_no_torch() -> None:
    code = "import sys, moveit6d.config; print('torch' in sys.modules or 'numpy' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
