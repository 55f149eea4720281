"""The options of the method seeds are the fields of its configuration."""

from __future__ import annotations

import argparse
import dataclasses

import pytest

from moveit6d.cli.seed_options import SHORT, add_seed_options, seeds_of
from moveit6d.config import LoopConfig, SeedDetectorConfig
from moveit6d.errors import InputError

PAPER = SeedDetectorConfig(criterion="iterations")
LOOP = LoopConfig(max_iterations=3)


def parsed(*options: str) -> SeedDetectorConfig:
    parser = argparse.ArgumentParser()
    add_seed_options(parser, PAPER)
    return seeds_of(parser.parse_args(options), PAPER, LOOP)


def test_without_options_it_is_the_base_with_the_loop_of_the_command() -> None:
    assert parsed() == dataclasses.replace(PAPER, loop=LOOP)


def test_every_field_but_the_loop_has_an_option_of_its_type() -> None:
    for field in dataclasses.fields(SeedDetectorConfig):
        if field.name == "loop":
            continue
        value = getattr(PAPER, field.name)
        words = [str(one) for one in value] if isinstance(value, tuple) else [str(value)]
        option = f"--{field.name}" if field.name in SHORT else f"--seeds.{field.name}"
        assert parsed(option, *words) == parsed(), field.name


def test_options_change_one_setting_each() -> None:
    found = parsed("--sizes", "0.1", "0.4", "--seeds.extent_ratio", "0.5", "2", "--poses", "1")
    assert found.sizes == (0.1, 0.4) and found.extent_ratio == (0.5, 2.0) and found.poses == 1
    assert (
        dataclasses.replace(
            found, sizes=PAPER.sizes, extent_ratio=PAPER.extent_ratio, poses=PAPER.poses
        )
        == parsed()
    )


def test_what_cannot_be_right_is_refused() -> None:
    with pytest.raises(InputError, match="poses, sinks and rotations must be 1 or more"):
        parsed("--sinks", "0")
