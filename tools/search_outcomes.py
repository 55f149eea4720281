"""Where searches and refinements end, and what the network saw on the way: for `fit_search_head`.

Synthetic pictures of meshes: among seven others on a table, or alone, moving, partly covered, and
slender in a third of the cases. In half of them the meshes have poor textures, as scans do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from moveit6d import Mesh, Pose, PoseDetector, make_renderer
from moveit6d.actions import PoseAction
from moveit6d.config import ContourConfig, DetectorConfig, MatchConfig, TrackerConfig
from moveit6d.estimation.half_turns import half_turned
from moveit6d.estimation.refine import refine_starts
from moveit6d.estimation.results import Refined, Start
from moveit6d.evaluation.metrics import ADD_LIMIT
from moveit6d.frame import Frame, prepare_frame
from moveit6d.geometry.mesh import Unit
from moveit6d.networks.compact import CompactCorrelationNet
from moveit6d.networks.policy_output import PolicyOutput
from moveit6d.networks.weights_file import load_network
from moveit6d.observation import Observation
from moveit6d.policies import LoopState, NetworkPolicy
from moveit6d.rendering.renderer import Renderer
from moveit6d.synthesis.default_camera import CAMERA
from moveit6d.synthesis.objects.slender import slender_copy
from moveit6d.synthesis.single_images import make_cases
from moveit6d.synthesis.training.clusters import ClusterConfig, draw_delta
from tools.scenes import Target, moving, relative_error, spoilt, spoilt_picture, table
from tools.training_files import read_photographs

TABLES = 0.65  # share of the pictures
SLENDER = 0.35  # share of the moving objects
POOR = 0.5  # share of the pictures with poor textures
CANDIDATES = 40  # of a search
CASES = 3  # single images of each cluster beside a moving object
SEARCH = TrackerConfig(
    detection=DetectorConfig(
        stages=((CANDIDATES, 1),), half_turns=0, match=MatchConfig(more_places=0)
    ),
    contour=ContourConfig(enabled=False),
)  # whose candidates are refined here
BATCH = 16  # loops side by side


@dataclass(frozen=True)
class Task:
    """One picture: its number, files of meshes and photographs to take from, and the weights."""

    number: int
    meshes: tuple[Path, ...]
    photos: tuple[Path, ...]
    weights: Path
    mesh_unit: Unit = "m"


@dataclass(frozen=True)
class Outcomes:
    """Of N iterations: what the confidence was told, and whether their loops ended right.

    `features` (N, F) float16, `before` (N,) the confidence, `right` (N,); `searched` (N,) says that
    the loop began at a candidate of a search, `last` (N,) that the iteration was its last one;
    `picture` (N,) is the picture's number.
    """

    features: NDArray[np.float16]
    before: NDArray[np.float32]
    right: NDArray[np.bool_]
    searched: NDArray[np.bool_]
    last: NDArray[np.bool_]
    picture: NDArray[np.int64]

    @staticmethod
    def joined(parts: Sequence[Outcomes]) -> Outcomes:
        """All of them."""
        names = Outcomes.__dataclass_fields__
        return Outcomes(**{k: np.concatenate([getattr(one, k) for one in parts]) for k in names})

    @staticmethod
    def load(path: Path) -> Outcomes:
        """What `save` wrote."""
        with np.load(path) as file:
            return Outcomes(**{name: file[name] for name in Outcomes.__dataclass_fields__})

    def save(self, path: Path) -> None:
        """Write a NumPy archive."""
        with path.open("wb") as file:
            np.savez_compressed(file, **vars(self))

    def part(self, rows: NDArray[np.bool_]) -> Outcomes:
        """Some of the iterations."""
        return Outcomes(**{name: values[rows] for name, values in vars(self).items()})


def without_search_head(network: CompactCorrelationNet) -> CompactCorrelationNet:
    """The network with the confidence of its training alone."""
    plain = CompactCorrelationNet(replace(network.config, search_head=False))
    plain.load_state_dict(network.state_dict(), strict=False)
    return plain.eval()


class Recorder(NetworkPolicy):
    """A network's policy that remembers where it was asked, and what its confidence was told."""

    def __init__(self, network: CompactCorrelationNet) -> None:
        super().__init__(without_search_head(network))
        self.poses: list[Pose] = []
        self.seen: list[tuple[int, Tensor, float]] = []  # target, features, confidence
        self._told: Tensor = torch.empty(0)
        plain = self.network.folded.network
        assert isinstance(plain, CompactCorrelationNet)
        plain.confidence_head.register_forward_hook(self._listen)

    def _listen(self, _: nn.Module, given: tuple[Tensor, ...], __: Tensor) -> None:
        self._told = given[0].half()

    @property
    def for_search(self) -> Recorder:
        """Itself: searches are listened to as well."""
        return self

    def predict(self, observation: Observation, state: LoopState) -> PolicyOutput:
        """One pass of the network, never traced, so that it can be listened to."""
        parts = [getattr(observation, name) for name in Observation.__dataclass_fields__]
        with torch.inference_mode():
            logits, confidence, attention, delta, information = self.network.folded(*parts)
        self.poses += [state.pose[row] for row in range(len(observation))]
        rows = zip(state.target.tolist(), self._told, confidence.tolist(), strict=True)
        self.seen += list(rows)
        return PolicyOutput(logits, delta, confidence, attention, information)

    def forget(self) -> None:
        """What was remembered."""
        self.poses, self.seen = [], []


def outcomes_of(task: Task) -> Outcomes | None:
    """What came of one picture; None if nothing can be seen in it."""
    torch.set_num_threads(1)
    rng = np.random.default_rng([task.number, 6])
    photos = read_photographs(task.photos)
    loaded = load_network(task.weights).network
    assert isinstance(loaded, CompactCorrelationNet), "only a compact network is fitted"
    recorder, renderer = Recorder(loaded), make_renderer()
    found: list[Outcomes] = []
    if rng.random() < TABLES:
        image, camera, targets = table(rng, task.meshes, photos, task.mesh_unit)
    else:
        mesh = Mesh.load(task.meshes[0], unit=task.mesh_unit, allow_flat=True)
        if rng.random() < SLENDER:
            mesh = slender_copy(rng, mesh)
        image, camera, targets = moving(rng, mesh, photos)
        found += _cases(rng, mesh, photos, recorder, renderer, task.number)
    if rng.random() < POOR:
        image = spoilt_picture(rng, image)
        targets = [replace(one, mesh=spoilt(rng, one.mesh)) for one in targets]
    frame = prepare_frame(image, camera)
    for target in targets:
        searched = candidates(frame, target.mesh, recorder, renderer)
        starts = [*searched, *near_starts(rng, target)]
        found.append(
            _refined(frame, target, starts, len(searched), recorder, renderer, task.number)
        )
    return Outcomes.joined(found) if found else None


def candidates(frame: Frame, mesh: Mesh, recorder: Recorder, renderer: Renderer) -> list[Pose]:
    """Centred poses that a search of the whole image tries first."""
    detector = PoseDetector(mesh, frame.camera, policy=recorder, renderer=renderer, config=SEARCH)
    recorder.forget()
    detector.detect(frame)
    return recorder.poses


def near_starts(rng: np.random.Generator, target: Target) -> list[Pose]:
    """Centred poses as tracks and refinements have them: near, far, and turned by half."""
    true = target.mesh.inner(target.truth.to(torch.float64))
    diameter = torch.tensor(target.mesh.sphere_diameter, dtype=torch.float64)
    turned = half_turned(target.mesh, true) or [true]  # by symmetries alone it is where it was
    clusters = ("all_small", "all_large", "all_large")
    moves = [(true, draw_delta(rng, ClusterConfig(), name)) for name in clusters]
    moves.append((true, rng.normal(0, (5, 5, 1.5, 4, 4, 4))))
    moves.append((true, rng.normal(0, (10, 10, 10, 25, 25, 25))))
    moves.append((turned[int(rng.integers(len(turned)))], rng.normal(0, (3, 3, 3, 6, 6, 6))))
    return [
        PoseAction.from_delta(torch.from_numpy(delta)).apply_centred(pose, diameter)
        for pose, delta in moves
    ]


def _cases(
    rng: np.random.Generator,
    mesh: Mesh,
    photos: Sequence[NDArray[np.uint8]],
    recorder: Recorder,
    renderer: Renderer,
    number: int,
) -> list[Outcomes]:
    """Refinements of single images of a mesh, small disturbances and large ones, covered."""
    found = []
    for cluster, occluded in (("all_small", 0.5), ("all_large", 1.0)):
        seed = int(rng.integers(1 << 31))
        for case in make_cases(
            [mesh], photos, renderer, cluster=cluster, occluded=occluded, number=CASES, seed=seed
        ):
            frame = prepare_frame(case.target.image, CAMERA)
            target = Target(mesh, case.truth)
            near = near_starts(rng, target)
            found.append(_refined(frame, target, near, 0, recorder, renderer, number))
    return found


def _refined(
    frame: Frame,
    target: Target,
    starts: Sequence[Pose],
    searched: int,
    recorder: Recorder,
    renderer: Renderer,
    number: int,
) -> Outcomes:
    """Refine starts of which the first `searched` are candidates of a search."""
    rows: list[tuple[Tensor, float, bool, bool, bool]] = []
    for first in range(0, len(starts), BATCH):
        some = starts[first : first + BATCH]
        recorder.forget()
        ends = refine_starts(
            [Start(frame, target.mesh, pose) for pose in some], policy=recorder, renderer=renderer
        )
        right = [_is_right(target, end) for end in ends]
        last = {row: k for k, (row, _, _) in enumerate(recorder.seen)}
        for k, (row, features, confidence) in enumerate(recorder.seen):
            rows.append((features, confidence, right[row], first + row < searched, last[row] == k))
    told, before, rights, origin, final = zip(*rows, strict=True)
    return Outcomes(
        torch.stack(told).numpy(),
        np.array(before, np.float32),
        np.array(rights),
        np.array(origin),
        np.array(final),
        np.full(len(rows), number),
    )


def _is_right(target: Target, end: Refined) -> bool:
    """Whether a loop ended below the limit of ADD."""
    pose = None if end.centred is None else target.mesh.outer(end.centred)
    return pose is not None and relative_error(target.mesh, pose, target.truth) < ADD_LIMIT
