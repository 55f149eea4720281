"""The paper's detection figure: field, divergence, steps against seeds; and how often it works.

Never gives the detector a true pose: the truth only judges, and is where the curve of steps starts.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from ...actions import PoseAction, pose_delta
from ...datasets.sequences import Sequence as Video
from ...datasets.video import Image
from ...estimation import SeedDetection, SeedDetector, SelectionCriterion, Target, refine_batch
from ...estimation.seed_detector import Candidate, best_of
from ...frame import prepare_frame
from ...geometry.pose import Pose
from ...visualization.charts import Curve, LineChart, Panel, Sheet
from .. import metrics
from . import published_figures as published
from .convergence import POINTS, Plan, frames_of, wanted_frames
from .reproduction import Cell, Reproduction, Table, mean

TURNS = tuple(range(-45, 46, 3))  # degrees about the viewing axis, for the last curve
FOUND = 0.5  # of the object's width: a sink nearer than this to the true centre is the object's


@dataclass(frozen=True)
class DetectionTrial:
    """One frame. Errors in diameters (ADD(-S)) and degrees; infinite and 180 without a pose.

    `rank` is the object's place among those looked into, from 1 (None: not among them); `size` the
    width tried there that is nearest to the true one, in true ones; `best` the smallest error of
    any candidate, which no criterion can better.
    """

    video: str
    frame: int
    rank: int | None
    size: float | None
    add: Mapping[SelectionCriterion, float]
    rotation: Mapping[SelectionCriterion, float]
    best: float
    seconds: float


@dataclass(frozen=True)
class Example:
    """What the figure shows of one frame."""

    image: Image
    detection: SeedDetection
    turns: tuple[float, ...]
    iterations: tuple[float, ...]
    ways: tuple[float, ...]


def run(
    videos: Sequence[Video], make: Mapping[str, SeedDetector], frames: int
) -> Iterator[tuple[DetectionTrial, Image, SeedDetection]]:
    """Detect in `frames` frames of every sequence, of which those that cannot be read are left out.

    `make` holds each sequence's detector.
    """
    for video in videos:
        detector = make[video.name]
        points = torch.from_numpy(detector.mesh.sample_points(POINTS))
        wanted = frames_of(video, Plan(frames=frames))
        for frame in wanted_frames(video, wanted):
            if frame.image is None:
                continue
            begin = time.perf_counter()
            found = detector.detect(frame.image)
            seconds = time.perf_counter() - begin
            truth = video.truth[frame.index].to(torch.float64)
            trial = _judged(video, frame.index, found, detector, truth, points, seconds)
            yield trial, frame.image, found


def _judged(
    video: Video,
    frame: int,
    found: SeedDetection,
    detector: SeedDetector,
    truth: Pose,
    points: Tensor,
    seconds: float,
) -> DetectionTrial:
    """One frame's figures: what each criterion chose among the same candidates."""

    def error(candidate: Candidate | None) -> float:
        if candidate is None or candidate.result.pose is None:
            return float("inf")
        apart = metrics.add_s(candidate.result.pose, truth, points, video.symmetric)
        return float(apart) / detector.mesh.diameter

    def turn(candidate: Candidate | None) -> float:
        if candidate is None or candidate.result.pose is None:
            return 180.0
        return float(metrics.rotation_error(candidate.result.pose, truth))

    chosen = {criterion: best_of(found.candidates, criterion) for criterion in SelectionCriterion}
    rank, size = _sink_of(found, detector, truth)
    return DetectionTrial(
        video=video.name,
        frame=frame,
        rank=rank,
        size=size,
        add={criterion: error(one) for criterion, one in chosen.items()},
        rotation={criterion: turn(one) for criterion, one in chosen.items()},
        best=min(map(error, found.candidates), default=float("inf")),
        seconds=seconds,
    )


def turned_starts(
    detector: SeedDetector, image: Image, truth: Pose, turns: Sequence[float] = TURNS
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Steps and ways of loops that start at the truth turned about the viewing axis, degrees.

    The figure's lower curve: the steps are fewest where the start is right.
    """
    mesh = detector.mesh
    inner = mesh.inner(truth.to(torch.float64))
    diameter = torch.full((len(turns),), mesh.sphere_diameter, dtype=torch.float64)
    delta = torch.zeros(len(turns), 6, dtype=torch.float64)
    delta[:, 5] = torch.tensor(list(turns), dtype=torch.float64)
    many = Pose(inner.rotation.expand(len(turns), 3, 3), inner.translation.expand(len(turns), 3))
    starts = PoseAction.from_delta(delta).apply_centred(many, diameter)
    frame = prepare_frame(image, detector.camera)
    targets = [
        Target(frame, detector.camera, mesh, mesh.outer(starts[k])) for k in range(len(turns))
    ]
    results = refine_batch(
        targets,
        policy=detector.policy,
        renderer=detector.renderer,
        loop=detector.loop,
    )
    ways = []
    for k, result in enumerate(results):
        way = float("nan")
        if result.pose is not None:
            end = mesh.inner(result.pose)
            way = float(pose_delta(starts[k], end, diameter[k]).abs().sum())
        ways.append(way)
    return tuple(float(result.iterations) for result in results), tuple(ways)


def reproduction(
    trials: Sequence[DetectionTrial], example: Example, data: str, facts: Mapping[str, object]
) -> Reproduction:
    """Figure `fig:detect` of one frame, and figures of all frames for both criteria."""
    rows: list[tuple[Cell, ...]] = []
    for trial in trials:
        adds = [_percent(trial.add[criterion]) for criterion in SelectionCriterion]
        turns = [trial.rotation[criterion] for criterion in SelectionCriterion]
        rows.append(
            (
                trial.video,
                trial.frame,
                trial.rank,
                trial.size,
                *adds,
                *turns,
                _percent(trial.best),
                trial.seconds,
            )
        )
    head = (
        "sequence",
        "frame",
        "rank of its sink",
        "best size tried / true",
        *(f"ADD % d, {criterion.value}" for criterion in SelectionCriterion),
        *(f"rotation deg, {criterion.value}" for criterion in SelectionCriterion),
        "best candidate ADD % d",
        "seconds",
    )
    frames = Table("frames", "Frame by frame", head, tuple(rows))
    return Reproduction(
        "detection",
        "Detection without a start (Initialization & Detection)",
        data,
        (_summary(trials), frames),
        (_sheet(example),),
        (
            "The paper prints no figures for detection; its figure is one example.",
            "A sink counts as the object's if it is nearer than half of the object's width to its "
            "centre. `best candidate` is what a perfect criterion would reach.",
            *published.NOTES["fig:detect"],
        ),
        facts,
    )


def _sink_of(
    found: SeedDetection, detector: SeedDetector, truth: Pose
) -> tuple[int | None, float | None]:
    """The first place (from 1) that is the object's, and the best size tried there, true = 1."""
    inner = detector.mesh.inner(truth)
    centre = detector.camera.project(inner.translation)
    distance = float(inner.translation.norm())
    width = detector.camera.fx * detector.mesh.sphere_diameter / distance
    for rank, place in enumerate(found.places, 1):
        if float((place[0].centre - centre).norm()) < FOUND * width:
            return rank, min((sink.size / width for sink in place), key=lambda r: abs(math.log(r)))
    return None, None


def _summary(trials: Sequence[DetectionTrial]) -> Table:
    number = len(trials)

    def share(hits: Sequence[bool]) -> float:
        return 100 * float(np.mean(hits))

    rows: list[tuple[Cell, ...]] = [
        ("object is the strongest sink, %", share([trial.rank == 1 for trial in trials])),
        ("object is among the sinks, %", share([trial.rank is not None for trial in trials])),
        ("best size tried there / true size, mean", mean([trial.size for trial in trials])),
    ]
    for criterion in SelectionCriterion:
        hits = [trial.add[criterion] < metrics.ADD_LIMIT for trial in trials]
        rows.append((f"ADD < 10 % d, criterion {criterion.value}, %", share(hits)))
    best = [trial.best < metrics.ADD_LIMIT for trial in trials]
    rows.append(("ADD < 10 % d, best candidate, %", share(best)))
    rows.append(("seconds a frame, mean", mean([trial.seconds for trial in trials])))
    return Table("summary", f"All {number} frames", ("", "ours"), tuple(rows))


def _sheet(example: Example) -> Sheet:
    """Field, divergence and the curve, as in the paper's figure; the largest sink's size."""
    detection = example.detection
    field = max(detection.fields, key=lambda one: float(one.sink.max()))
    arrows = torch.cat([field.centres, field.vectors], -1).reshape(-1, 4).numpy()
    first = detection.places[0][0] if detection.places else None
    crosses, box = {}, None
    if first is not None:
        x, y = first.centre.tolist()
        crosses["centre"] = (float(x), float(y))
        half = 0.5 * first.size
        box = (float(x) - half, float(y) - half, float(x) + half, float(y) + half)
    left, top = field.centres[0, 0].tolist()
    step = float(field.centres[0, 1, 0] - field.centres[0, 0, 0])
    inside = {name: ((x - left) / step, (y - top) / step) for name, (x, y) in crosses.items()}
    curves = [Curve("iterations", example.turns, example.iterations)]
    way = [(t, w) for t, w in zip(example.turns, example.ways, strict=True) if np.isfinite(w)]
    if way:
        x_way, y_way = zip(*way, strict=True)
        curves.append(Curve("way, single actions", x_way, y_way, right=True))
    chart = LineChart(
        "turned",
        "",
        "start turned about the viewing axis (r_z), degrees",
        "steps to stop",
        tuple(curves),
        "way in single actions",
    )
    return Sheet(
        "detection",
        "Detection",
        3,
        (
            Panel("t_x, t_y of one iteration a seed", example.image, arrows, crosses, box),
            Panel("−∇·V of the smoothed field", field.sink.numpy(), crosses=inside),
            Panel("steps against the start", lines=chart),
        ),
    )


def _percent(share: float) -> float | None:
    return 100 * share if np.isfinite(share) else None
