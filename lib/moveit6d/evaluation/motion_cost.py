"""How many iterations a frame costs, by how fast the object moves: the paper's dynamic complexity.

Never scores poses.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..config import TrackerConfig
from ..estimation import PoseTracker
from ..geometry.mesh import Mesh
from ..policies import Policy
from ..rendering.renderer import Renderer
from ..synthesis.sequences.difficulty import Difficulty, find_difficulty
from ..synthesis.sequences.sequence import Scene
from .tables import markdown

DEFAULT = TrackerConfig()
DEGREES = 0.4  # a frame, for each pixel a frame


@dataclass(frozen=True)
class MotionCost:
    """Iterations and milliseconds a frame, means over a sequence; `pixels` a frame at its fastest.

    `still` is the share of frames that took one iteration.
    """

    pixels: float
    iterations: float
    milliseconds: float
    still: float


def motion_costs(
    mesh: Mesh,
    speeds: Sequence[float],
    frames: int,
    policy: Policy,
    renderer: Renderer,
    seed: int,
    config: TrackerConfig = DEFAULT,
    threads: int | None = 1,
) -> Iterator[MotionCost]:
    """Track one object in made sequences of increasing speed, each from its exact start.

    With so many CPU threads; None: as many as the program has set.
    """
    for speed in speeds:
        scene = Scene(mesh, seed, frames, _moving(speed))
        first = scene.render_frame(0)
        tracker = PoseTracker(
            mesh, scene.camera, first.pose, policy=policy, renderer=renderer, config=config,
            threads=threads,
        )  # fmt: skip
        if config.calibration.enabled:
            tracker.calibrate(first.image)
        results = [tracker.update(scene.render_frame(k).image) for k in range(1, frames)]
        counts = np.array([result.iterations for result in results])
        spent = np.array([result.milliseconds for result in results])
        yield MotionCost(speed, counts.mean(), float(np.median(spent)), float((counts <= 1).mean()))


def motion_table(costs: Sequence[MotionCost]) -> str:
    """A line a speed, as Markdown."""
    head = ("pixels a frame", "iterations a frame", "frames of one iteration", "median ms")
    return markdown(head, [
        [f"{c.pixels:g}", f"{c.iterations:.2f}", f"{100 * c.still:.0f} %", f"{c.milliseconds:.0f}"]
        for c in costs
    ])  # fmt: skip


def _moving(speed: float) -> Difficulty:
    """The easy difficulty at one speed; 0 is as good as still."""
    speed = max(speed, 1e-3)
    turn = DEGREES * speed
    return replace(
        find_difficulty("easy"), pixels_per_frame=(speed, speed), degrees_per_frame=(turn, turn)
    )
