"""`moveit6d benchmark` and `moveit6d evaluate`: tables beside rivals, tracks, videos, times."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from moveit6d.cli.main import main

Make = Callable[..., Any]


def test_the_parts_of_an_iteration_are_printed(
    sequences: Path, brick_file: Path, capsys: Any
) -> None:
    assert (
        main(
            [
                "benchmark",
                "iteration",
                "--mesh",
                str(brick_file),
                "--repeats",
                "2",
                "--threads",
                "1",
            ]
        )
        == 0
    )
    text = capsys.readouterr().out
    for part in ("crop", "render", "observe", "network", "move", "sum", "whole iteration"):
        assert part in text
    assert "1 threads" in text and "median of 2" in text
