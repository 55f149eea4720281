"""Configurations are plain data, documented field by field, and refuse what cannot be right."""

from __future__ import annotations

import dataclasses
import json
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
    ],
)
def test_what_cannot_be_right_is_refused(kind: type, given: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        kind(**given)


def test_the_module_needs_no_torch() -> None:
    code = "import sys, moveit6d.config; print('torch' in sys.modules or 'numpy' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
