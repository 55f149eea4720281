"""Configurations that tests share."""

from __future__ import annotations

from moveit6d.config import ContourConfig, LoopConfig, MultiStartConfig, TrackerConfig

LOW_CONFIDENCE = TrackerConfig().low_confidence
HIGH_CONFIDENCE = TrackerConfig().high_confidence
NO_CONTOUR = TrackerConfig(contour=ContourConfig(enabled=False))
ALWAYS_CONTOUR = TrackerConfig(contour=ContourConfig(moves_below=1.1))  # however sure a policy is
LOOP_ONLY = TrackerConfig(
    contour=ContourConfig(enabled=False), multi_start=MultiStartConfig(enabled=False)
)
# Options of commands that make them look for objects quickly and roughly.
FAST_DETECTION = [
    "--detection.templates.rotations", "40", "--detection.templates.coarse_rotations", "20",
    "--detection.match.widths", "[0.5, 0.9]", "--detection.stages", "[[4, 2]]",
]  # fmt: skip


def limited(iterations: int, step_size: float = 1.0) -> LoopConfig:
    """A loop of so many iterations at most."""
    return LoopConfig(max_iterations=iterations, step_size=step_size)
