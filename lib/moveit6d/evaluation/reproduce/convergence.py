"""The paper's robustness test (Eq. 3): starts ever farther from the truth, and who comes back.

Never tracks: every start is a loop of its own in one frame. The deviation can be read in two ways,
see `Reading`; both are offered because only one of them fits the paper's own text.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
import torch
from torch import Tensor

from ...actions import PoseAction
from ...config import PAPER_CONFIG, LoopConfig
from ...datasets.sequences import Sequence as Video
from ...datasets.video import VideoFrame
from ...errors import InputError
from ...estimation import StopReason, Target, refine_batch
from ...frame import prepare_frame
from ...geometry.mesh import Mesh
from ...geometry.pose import Pose
from ...policies import Policy
from ...rendering.renderer import Renderer
from ...visualization.charts import Curve, LineChart
from .. import metrics
from . import published_figures as published
from .reproduction import Cell, Reproduction, Table, mean

POINTS = 1000


class Reading(StrEnum):
    """How far m perturbs each of the six axes."""

    FORMULA = "formula"  # as Eq. 3 stands: Δ m = 6 m units an axis
    TOTAL = "total"  # as the text's "270 actions apart": m units an axis, six axes


@dataclass(frozen=True)
class ConvergenceTrial:
    """One start: the reading, m and frame, ADD(-S) in diameters before and after, steps.

    `after` is infinite for a loop that did not end by itself within the limit; `before` for a start
    that the camera cannot see, which is not run.
    """

    reading: Reading
    m: int
    frame: int
    before: float
    after: float
    iterations: int

    @property
    def right(self) -> bool:
        """Whether it came back."""
        return self.after < metrics.ADD_LIMIT


# The paper's: single actions of 3 units, at most 200 of them.
LOOP = replace(
    PAPER_CONFIG.loop,
    max_iterations=published.CONVERGENCE_STEPS,
    step_size=published.CONVERGENCE_STEP,
)


@dataclass(frozen=True)
class Plan:
    """What is tried: the ms, the readings, frames at most, and how the loop runs."""

    ms: tuple[int, ...] = tuple(range(published.CONVERGENCE_LARGEST + 1))
    readings: tuple[Reading, ...] = tuple(Reading)
    frames: int | None = None
    loop: LoopConfig = LOOP
    seed: int = 0

    def __post_init__(self) -> None:
        if not self.ms or min(self.ms) < 0:
            raise InputError("convergence: m must be 0 or more.")


def units(m: int, reading: Reading) -> int:
    """How many unit actions an axis is moved by."""
    return m * (published.CONVERGENCE_DELTA if reading is Reading.FORMULA else 1)


def deviate(truth: Pose, signs: Tensor, count: Sequence[int], sphere_diameter: float) -> Pose:
    """Centred poses (N) moved by `count[i]` unit actions on every axis, in directions (N, 6).

    One unit after the other, each measured in the patch of the pose before it, as the paper adds
    actions; at once a large negative t_z would be beyond infinity.
    """
    diameter = torch.full((len(signs),), sphere_diameter, dtype=torch.float64)
    pose, left = truth, torch.tensor(list(count))
    for done in range(max(count, default=0)):
        going = (left > done).to(torch.float64)[:, None]
        pose = PoseAction.from_delta(signs * going).apply_centred(pose, diameter)
    return pose


def share_of_frames(m: int) -> float:
    """The paper takes fewer frames where loops are long."""
    return 1.0 if m < 25 else 0.25 if m <= 30 else 0.1


def frames_of(video: Video, plan: Plan) -> list[int]:
    """The frames used: the scored ones with a known pose, evenly thinned to `plan.frames`."""
    known = sorted(video.truth if video.keyframes is None else video.keyframes & set(video.truth))
    if not known:
        raise InputError(f"{video.name} has no frame with a true pose.")
    if plan.frames is None or plan.frames >= len(known):
        return known
    chosen = np.linspace(0, len(known) - 1, plan.frames).round().astype(int)
    return [known[k] for k in chosen]


def wanted_frames(video: Video, wanted: Sequence[int]) -> Iterator[VideoFrame]:
    """The frames of these numbers (sorted); one that the video lacks comes without an image."""
    left = deque(wanted)
    for frame in video.open():
        while left and left[0] < frame.index:
            yield VideoFrame(left.popleft(), "", None)
        if left and left[0] == frame.index:
            left.popleft()
            yield frame
        if not left:
            return
    for index in left:
        yield VideoFrame(index, "", None)


def run(
    video: Video, policy: Policy, renderer: Renderer, plan: Plan
) -> Iterator[list[ConvergenceTrial]]:
    """All trials of one frame after the other; none of a frame that cannot be read."""
    mesh = video.load_mesh()
    points = torch.from_numpy(mesh.sample_points(POINTS))
    wanted = frames_of(video, plan)
    random = np.random.default_rng(plan.seed)
    used: dict[tuple[Reading, int], set[int]] = {}
    for reading in plan.readings:
        for m in plan.ms:
            number = max(1, round(share_of_frames(m) * len(wanted)))
            used[reading, m] = {wanted[k] for k in random.permutation(len(wanted))[:number]}
    for frame in wanted_frames(video, sorted(set().union(*used.values()))):
        if frame.image is None:
            yield []
            continue
        cases = [key for key, frames in used.items() if frame.index in frames]
        signs = torch.from_numpy(random.choice([-1.0, 1.0], (len(cases), 6)))
        yield _trials(video, mesh, points, frame, cases, signs, policy, renderer, plan)


def _trials(
    video: Video,
    mesh: Mesh,
    points: Tensor,
    frame: VideoFrame,
    cases: list[tuple[Reading, int]],
    signs: Tensor,
    policy: Policy,
    renderer: Renderer,
    plan: Plan,
) -> list[ConvergenceTrial]:
    truth = video.truth[frame.index].to(torch.float64)
    inner = mesh.inner(truth)
    many = Pose(inner.rotation.expand(len(cases), 3, 3), inner.translation.expand(len(cases), 3))
    counts = [units(m, reading) for reading, m in cases]
    moved = deviate(many, signs, counts, mesh.sphere_diameter)
    picture = prepare_frame(frame.image, video.camera)
    targets = [Target(picture, video.camera, mesh, mesh.outer(moved[k])) for k in range(len(cases))]
    results = refine_batch(targets, policy=policy, renderer=renderer, loop=plan.loop)

    def error(pose: Pose) -> float:
        return float(metrics.add_s(pose, truth, points, video.symmetric)) / mesh.diameter

    found = []
    for k, (reading, m) in enumerate(cases):
        result = results[k]
        before, after, iterations = float("inf"), float("inf"), 0
        if result.iterations > 0:  # else the camera cannot see the start
            before, iterations = error(mesh.outer(moved[k])), result.iterations
            if result.pose is not None and result.stopped_by is not StopReason.MAX_ITERATIONS:
                after = error(result.pose)
        found.append(ConvergenceTrial(reading, m, frame.index, before, after, iterations))
    return found


def reproduction(
    trials: Sequence[ConvergenceTrial], data: str, facts: dict[str, object]
) -> Reproduction:
    """Figure `fig:robustness`: ADD score and steps of the loops that came back, against m."""
    rows: list[tuple[Cell, ...]] = []
    curves: list[Curve] = []
    for reading in Reading:
        mine = [trial for trial in trials if trial.reading is reading]
        lines = [_row(m, reading, mine) for m in sorted({trial.m for trial in mine})]
        rows += lines
        scored = [(float(m), float(share)) for _, m, _, _, _, share, _, _ in lines]
        walked = [
            (float(m), iterations)
            for _, m, _, _, _, _, iterations, _ in lines
            if iterations is not None
        ]
        for label, points, right in (("ADD score", scored, False), ("iterations", walked, True)):
            if points:
                x, y = zip(*points, strict=True)
                curves.append(Curve(f"{label}, {reading.value}", x, y, right))
    stated = tuple(zip(*published.CONVERGENCE_ADD.items(), strict=True))
    curves.append(Curve("paper's ADD score", stated[0], stated[1], dots=True))
    head = (
        "reading",
        "m",
        "units an axis",
        "starts",
        "start ADD % d",
        "ADD<10%d",
        "steps where right",
        "paper ADD<10%d",
    )
    title = "ADD score and steps against the deviation (fig:robustness)"
    chart = LineChart(
        "convergence",
        "Robustness to the start",
        "m",
        "ADD < 10 % d, %",
        tuple(curves),
        "steps of the loops that came back",
    )
    return Reproduction(
        "convergence",
        "Convergence from deviated starts (Eq. 3)",
        data,
        (Table("convergence", title, head, tuple(rows), 1),),
        (chart,),
        (
            f"The paper did not converge from m = {published.CONVERGENCE_NONE_FROM} on.",
            "A loop that runs into the limit of steps, and a start that the camera cannot see, "
            "count as not converged.",
            *published.NOTES["eq:adding_noise"],
        ),
        facts,
    )


def _row(
    m: int, reading: Reading, trials: Sequence[ConvergenceTrial]
) -> tuple[str, int, int, int, float | None, float, float | None, float | None]:
    mine = [trial for trial in trials if trial.m == m]
    before = mean([100 * trial.before for trial in mine if np.isfinite(trial.before)])
    share = 100 * float(np.mean([trial.right for trial in mine]))
    iterations = mean([float(trial.iterations) for trial in mine if trial.right])
    printed = published.CONVERGENCE_ADD.get(m)
    return reading.value, m, units(m, reading), len(mine), before, share, iterations, printed
