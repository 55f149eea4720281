"""Fits `VerificationConfig`, `StateConfig` and `SingleImageConfig`: how likely a pose is right.

    python -m tools.fit_probabilities --meshes MESHES --photos PHOTOS [--weights FILE]
        [--mesh_unit mm] [--holdout 8] [--calibrated FILE] [--sequences FOLDER …] [--jobs 2]

On synthetic pictures and sequences of training meshes that were held out (by the rule of
`PairDataModule`), objects that are not there among them. Prints the weights and, cross-validated by
mesh, the area under the ROC curve. To be run anew for a network with other weights; a few minutes
a mesh.

With `--calibrated` the confidence of a compact network is calibrated first (Platt scaling: a line
in its logit, fitted on where refinements and tracks end; Platt 1999), and the network whose last
layer has that line is written there. The regressions are of that network then.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from moveit6d import Mesh, Pose, PoseDetector, load_policy, make_renderer
from moveit6d.actions import PoseAction
from moveit6d.config import SingleImageConfig, TrackerConfig
from moveit6d.errors import InputError
from moveit6d.estimation import TemplateStore
from moveit6d.estimation.estimator import refine_single
from moveit6d.estimation.final_confidence import search_confidences
from moveit6d.estimation.results import Refined, Target, TrackingResult, starts_of
from moveit6d.estimation.states import log_odds
from moveit6d.evaluation.metrics import auroc
from moveit6d.evaluation.metrics.calibration import reliability
from moveit6d.geometry.mesh import Unit
from moveit6d.networks.compact import CompactCorrelationNet
from moveit6d.networks.weights_file import load_network, save_network
from moveit6d.parallel import run_jobs
from moveit6d.policies import SHIPPED_WEIGHTS, NetworkPolicy
from moveit6d.rendering.renderer import Renderer
from moveit6d.synthesis.augmentation.photos import photo_files
from moveit6d.synthesis.sequences.sequence import Scene
from moveit6d.synthesis.single_images import make_cases
from moveit6d.synthesis.training.clusters import ClusterConfig, draw_delta
from tools.scenes import of_size, relative_error, spoilt, spoilt_picture, table
from tools.tracked_frames import (
    DIFFICULTIES,
    FRAMES,
    Example,
    tracked_frames,
    uncoloured_frames,
)
from tools.training_files import add_options, check_held_out, data_of, read_photographs

TABLETOP = "easy"  # with other objects around the first one, which touch and hide it
POOR = 0.5  # share of the pictures of tables that are spoilt
PHOTOS = 150  # read at most
STARTS = (("all_small", 0.0), ("all_large", 0.0), ("all_large", 1.0))  # cluster, share occluded
REFINED = 40  # pictures of each mesh and kind of start, and starts of each mesh on tables
RIDGE = 2.0
PLAIN = TrackerConfig(single_image=SingleImageConfig(1.0, 0.0, 0.0))  # the confidence itself


def main(arguments: Sequence[str] | None = None) -> int:
    """Make, look, fit, print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    add_options(parser)
    parser.add_argument("--weights", type=Path, help="weights file instead of the shipped one")
    parser.add_argument("--calibrated", type=Path, help="file for the calibrated network")
    parser.add_argument(
        "--sequences", type=Path, nargs="*", default=(),
        help="folders with sequences DIFFICULTY_MESH of held-out meshes, tracked without colours",
    )  # fmt: skip
    parser.add_argument("--pictures", type=int, default=2, help="of each mesh and difficulty")
    parser.add_argument("--seed", type=int, default=0, help="of the pictures")
    parser.add_argument("--jobs", type=int, default=1, help="meshes worked on at a time")
    args = parser.parse_args(arguments)
    data = data_of(args)
    check_held_out(data)
    paths = data.mesh_paths()[1]
    tasks = [
        Task(path, paths[(number + 1) % len(paths)], tuple(
                 one for k, one in enumerate(paths) if (k - number) % len(paths) > 1
             ), args.seed + 10 * number, args.photos, args.weights or SHIPPED_WEIGHTS,
             args.pictures, args.mesh_unit)
        for number, path in enumerate(paths)
    ]  # fmt: skip
    done = sorted(run_jobs(examples_of, tasks, jobs=args.jobs), key=lambda job: job.index)
    for job in done:
        if job.result is None:
            print(f"{tasks[job.index].mesh.name} teaches nothing: {job.error}")
    gathered = [job.result for job in done if job.result is not None]
    if not gathered:
        raise InputError("There are no examples: see what is said of each mesh above.")
    found, followed, refined, present, uncoloured = (
        [one for result in gathered for one in result[kind]] for kind in range(5)
    )
    policy = load_policy(args.weights or SHIPPED_WEIGHTS)
    uncoloured += [one for path in args.sequences for one in uncoloured_frames(path, policy)]
    if args.calibrated is not None:
        given = args.weights or SHIPPED_WEIGHTS
        line = platt([*(one for one in followed if np.isfinite(one.error)), *refined])
        write_calibrated(given, line, args.calibrated)
        followed, refined = calibrated(followed, line), calibrated(refined, line)
        uncoloured = calibrated(uncoloured, line)
        if policy.for_search is policy:  # else searches ask a head that the line is not in
            found, present = calibrated(found, line), calibrated(present, line)
    sure = without_borderline(in_log_odds(found))
    weights = report("VerificationConfig", ("confidence", "similarity"), sure)
    report_present(weights, in_log_odds(present))
    report("StateConfig", ("confidence", "agreement"), without_borderline(followed))
    # Without colours a seventh of the poses are borderline: left out they make all seem surer.
    report("StateConfig, uncoloured", ("confidence", "agreement"), in_log_odds(uncoloured))
    both = [replace(one, evidence=tuple(map(log_odds, one.evidence))) for one in refined]
    report("SingleImageConfig", ("confidence", "search_confidence"), without_borderline(both))
    return 0


@dataclass(frozen=True)
class Task:
    """One mesh, another one that is not in its pictures, and what the pictures are made with.

    `beside` are meshes that stand around it on tabletops.
    """

    mesh: Path
    other: Path
    beside: tuple[Path, ...]
    seed: int
    photos: Path
    weights: Path
    pictures: int
    mesh_unit: Unit = "m"


def examples_of(task: Task) -> tuple[list[Example], ...]:
    """Examples of one mesh: of detections, tracks, refinements, and detections of what is there.

    And of tracks without the mesh's colours.
    """
    torch.set_num_threads(1)
    paths = (task.mesh, task.other, *task.beside)
    loaded = [Mesh.load(path, unit=task.mesh_unit, allow_flat=True) for path in paths]
    meshes, beside = loaded[:2], [of_size(one, loaded[0].diameter) for one in loaded[2:]]
    found = read_photographs(photo_files(task.photos))
    photos = found[:: max(1, len(found) // PHOTOS)]
    policy = load_policy(task.weights)
    return (
        list(candidates(meshes, beside, photos, policy, task.pictures, task.seed)),
        list(tracked_frames(meshes[0], photos, policy, task.seed)),
        list(refinements(meshes[0], beside, photos, policy, task.seed)),
        list(present_ones(paths, photos, policy, task.seed, task.mesh_unit)),
        list(tracked_frames(meshes[0], photos, policy, task.seed, coloured=False)),
    )


def refinements(
    mesh: Mesh, beside: Sequence[Mesh], photos: Sequence[NDArray[np.uint8]],
    policy: NetworkPolicy, seed: int,
) -> Iterator[Example]:  # fmt: skip
    """Where refinements of single pictures end, from near and from far starts."""
    renderer = make_renderer()
    for number, (cluster, occluded) in enumerate(STARTS):
        cases = make_cases(
            [mesh], photos, renderer, cluster=cluster, occluded=occluded, number=REFINED,
            seed=seed + number,
        )  # fmt: skip
        for case in cases:
            yield from refined_once(case.target, case.truth, policy, renderer)
    rng = np.random.default_rng(seed)
    for order in range(2):
        scene = Scene(mesh, seed + 700 + order, FRAMES, TABLETOP, photos, others=beside)
        for k in range(REFINED // 2):
            frame = scene.render_frame(k * FRAMES * 2 // REFINED)
            delta = draw_delta(rng, ClusterConfig(), STARTS[k % 2][0])
            start = PoseAction.from_delta(torch.from_numpy(delta)).apply(frame.pose, mesh)
            target = Target(frame.image, scene.camera, mesh, start)
            yield from refined_once(target, frame.pose, policy, renderer)


def refined_once(
    target: Target, truth: Pose, policy: NetworkPolicy, renderer: Renderer
) -> Iterator[Example]:
    """Where one refinement ends, if anywhere."""
    result = refine_single([target], policy=policy, renderer=renderer, config=PLAIN)[0]
    if result.pose is not None:
        error = relative_error(target.mesh, result.pose, truth)
        said = said_for_searches(target, result, policy, renderer)
        yield Example((result.confidence, said), error, target.mesh.name)


def said_for_searches(
    target: Target, result: TrackingResult, policy: NetworkPolicy, renderer: Renderer
) -> float:
    """The confidence for searches at a pose that was found, as `refine_single` asks for it."""
    assert result.pose is not None
    start = starts_of([target])[0]
    centred = target.mesh.inner(result.pose)
    end = Refined(centred, 0, result.stopped_by, result.confidence, 0.0)
    asked = search_confidences([start], [end], policy=policy, renderer=renderer, loop=PLAIN.loop)
    return asked[0].confidence if asked else 0.5  # no weight of it then


def without_borderline(examples: Sequence[Example]) -> list[Example]:
    """The examples that are right or wrong."""
    return [one for one in examples if not one.borderline]


def logit(confidence: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of confidences (N,), bounded."""
    return np.array([log_odds(value) for value in confidence.tolist()])


def platt(examples: Sequence[Example]) -> NDArray[np.float64]:
    """Slope and intercept (2,) of the calibrated logit, printed with what they change."""
    if not examples:
        raise InputError("--calibrated: there are no examples of where tracks and refinements end.")
    confidence = np.array([one.evidence[0] for one in examples])
    right = np.array([one.right for one in examples])
    line = fit(logit(confidence)[:, None], right)
    after = probability(line, logit(confidence)[:, None])
    truth = torch.from_numpy(right)
    old, new = (
        reliability(torch.from_numpy(values), truth).calibration_error
        for values in (confidence, after)
    )
    print(
        f"confidence: slope {line[0]:.3f}, intercept {line[1]:.3f} ({len(right)} poses, "
        f"{right.mean():.0%} right, expected calibration error {old:.3f} before, {new:.3f} after)"
    )
    return line


def calibrated(examples: Sequence[Example], line: NDArray[np.float64]) -> list[Example]:
    """The examples with what a calibrated network would have said."""
    confidence = np.array([one.evidence[0] for one in examples])
    return _with_first(examples, probability(line, logit(confidence)[:, None]))


def in_log_odds(examples: Sequence[Example]) -> list[Example]:
    """The examples with the log odds of the confidence instead of it."""
    return _with_first(examples, logit(np.array([one.evidence[0] for one in examples])))


def _with_first(examples: Sequence[Example], values: NDArray[np.float64]) -> list[Example]:
    """The examples with other first values (N,) of their evidence."""
    return [
        replace(one, evidence=(value, one.evidence[1]))
        for one, value in zip(examples, values.tolist(), strict=True)
    ]


def write_calibrated(weights: Path, line: NDArray[np.float64], path: Path) -> None:
    """The network of a weights file with the line in the last layer of its confidence."""
    loaded = load_network(weights)
    network = loaded.network
    assert isinstance(network, CompactCorrelationNet), "only a compact network is calibrated"
    last = network.confidence_head[-1]
    assert isinstance(last, torch.nn.Linear)
    slope, intercept = line.tolist()
    with torch.no_grad():
        last.weight.mul_(slope)
        last.bias.mul_(slope).add_(intercept)
    save_network(network, path, loaded.facts)


def candidates(
    meshes: Sequence[Mesh], beside: Sequence[Mesh], photos: Sequence[NDArray[np.uint8]],
    policy: NetworkPolicy, pictures: int, seed: int,
) -> Iterator[Example]:  # fmt: skip
    """Where detections end, of the first mesh, which is in the pictures, and of the other."""
    renderer, store, mesh = make_renderer(), TemplateStore(), meshes[0]
    for order, difficulty in enumerate((*DIFFICULTIES, TABLETOP, TABLETOP)):
        others = beside if difficulty == TABLETOP else ()
        scene = Scene(mesh, seed + order, FRAMES, difficulty, photos, others=others)
        for k in range(pictures):
            frame = scene.render_frame(k * FRAMES // pictures)
            for wanted in meshes:
                detector = PoseDetector(
                    wanted, scene.camera, policy=policy, renderer=renderer, store=store
                )
                seen = detector.detect(frame.image)
                for one in (*seen.instances, *seen.rejected):
                    error = relative_error(mesh, one.pose, frame.pose)
                    assert one.evidence is not None
                    values = one.evidence.confidence, one.evidence.similarity
                    yield Example(values, error if wanted is mesh else np.inf, wanted.name)


def present_ones(
    paths: Sequence[Path], photos: Sequence[NDArray[np.uint8]], policy: NetworkPolicy, seed: int,
    unit: Unit,
) -> Iterator[Example]:  # fmt: skip
    """The best pose of each search for an object of a table that is small in a photograph."""
    renderer, rng = make_renderer(), np.random.default_rng([seed, 0])
    image, camera, targets = table(rng, paths, photos, unit)
    spoil = rng.random() < POOR
    if spoil:
        image = spoilt_picture(rng, image)
    for target in targets:
        mesh = spoilt(rng, target.mesh) if spoil else target.mesh
        best = PoseDetector(mesh, camera, policy=policy, renderer=renderer).detect(image).best
        if best is not None and best.evidence is not None:
            error = relative_error(mesh, best.pose, target.truth)
            values = best.evidence.confidence, best.evidence.similarity
            yield Example(values, error, target.mesh.name)


def report(
    name: str, names: Sequence[str], examples: Sequence[Example]
) -> NDArray[np.float64] | None:
    """The weights, printed with how well those fitted without a mesh do on it."""
    if not examples:
        print(f"{name}: no examples")
        return None
    values = np.array([one.evidence for one in examples])
    right = np.array([one.right for one in examples])
    owner = np.array([one.mesh for one in examples])
    chance = np.zeros(len(examples))
    for mesh in sorted(set(owner)):
        weights = fit(values[owner != mesh], right[owner != mesh])
        chance[owner == mesh] = probability(weights, values[owner == mesh])
    area = auroc(torch.from_numpy(chance), torch.from_numpy(right))
    surprise = -np.log(np.where(right, chance, 1 - chance).clip(1e-9)).mean()
    weights = fit(values, right)
    fitted = ", ".join(
        f"{part} {value:.2f}" for part, value in zip([*names, "intercept"], weights, strict=True)
    )
    print(
        f"{name}: {fitted} ({len(examples)} poses, {right.mean():.0%} right, AUROC {area:.3f}, "
        f"log loss {surprise:.4f})"
    )
    return weights


def report_present(weights: NDArray[np.float64] | None, examples: Sequence[Example]) -> None:
    """Print by how much the log odds of the weights (K + 1,) are to be raised for the examples."""
    if weights is None or not examples:
        print("VerificationConfig: present: no examples")
        return
    values = np.array([one.evidence for one in examples])
    right = np.array([one.right for one in examples])
    more = shift(weights, values, right)
    raised = np.append(weights[:-1], weights[-1] + more)
    before, after = (
        reliability(torch.from_numpy(probability(some, values)), torch.from_numpy(right))
        for some in (weights, raised)
    )
    print(
        f"VerificationConfig: present {more:.2f} ({len(right)} searches, {right.mean():.0%} right, "
        f"expected calibration error {before.calibration_error:.3f} before, "
        f"{after.calibration_error:.3f} after)"
    )


def shift(
    weights: NDArray[np.float64], values: NDArray[np.float64], right: NDArray[np.bool_]
) -> float:
    """What to add to the intercept so that so many of the values (N, K) are right."""
    more = 0.0
    for _ in range(50):  # Newton's method
        chance = probability(np.append(weights[:-1], weights[-1] + more), values)
        more -= (chance - right).sum() / (chance * (1 - chance)).sum()
    return float(more)


def fit(values: NDArray[np.float64], right: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Weights (K + 1,), the intercept last, of a ridge logistic regression on values (N, K)."""
    mean, spread = values.mean(0), values.std(0) + 1e-9
    rows = np.column_stack([(values - mean) / spread, np.ones(len(values))])
    ridge = np.diag([RIDGE] * values.shape[1] + [1e-6])
    weights = np.zeros(rows.shape[1])
    for _ in range(50):  # Newton's method
        chance = 1 / (1 + np.exp(-rows @ weights))
        slope = rows.T @ (chance - right) + ridge @ weights
        curvature = (rows * (chance * (1 - chance))[:, None]).T @ rows + ridge
        weights -= np.linalg.solve(curvature, slope)
    scaled = weights[:-1] / spread
    return np.append(scaled, weights[-1] - scaled @ mean)


def probability(weights: NDArray[np.float64], values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of being right (N,), by weights (K + 1,) and values (N, K)."""
    chance: NDArray[np.float64] = 1 / (1 + np.exp(-(values @ weights[:-1] + weights[-1])))
    return chance


if __name__ == "__main__":
    try:
        sys.exit(main())
    except InputError as error:
        sys.exit(f"fit_probabilities: {error}")
