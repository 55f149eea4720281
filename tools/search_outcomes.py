"""Where searches and refinements end, and what the network saw on the way: for `fit_search_head`.

Synthetic pictures of meshes: among seven others on a table, or alone, moving, partly covered, and
slender in a third of the cases. In half of them the meshes have poor textures, as scans do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from moveit6d import Camera, Mesh, Pose, PoseDetector, make_renderer
from moveit6d.actions import PoseAction
from moveit6d.config import ContourConfig, DetectorConfig, MatchConfig, TrackerConfig
from moveit6d.datasets.video import read_image
from moveit6d.estimation.half_turns import half_turned
from moveit6d.estimation.refine import refine_starts
from moveit6d.estimation.results import Refined, Start
from moveit6d.evaluation.metrics import ADD_LIMIT
from moveit6d.frame import Frame, prepare_frame
from moveit6d.networks.compact import CompactCorrelationNet
from moveit6d.networks.policy_output import PolicyOutput
from moveit6d.networks.weights_file import load_network
from moveit6d.observation import Observation
from moveit6d.policies import LoopState, NetworkPolicy
from moveit6d.rendering.renderer import Renderer
from moveit6d.synthesis.default_camera import CAMERA
from moveit6d.synthesis.objects.slender import slender_copy
from moveit6d.synthesis.sequences.sequence import Scene
from moveit6d.synthesis.single_images import make_cases
from moveit6d.synthesis.training.clusters import ClusterConfig, draw_delta
from tools.fit_probabilities import of_size, relative_error

FRAMES = 44  # of a scene, of which one is looked at
SIZES = (0.13, 0.28)  # metres, of objects on a table
OTHERS = 7  # beside an object on a table
FLATTEST = 0.2  # of the diameter: what is flatter does not stand on a table
TABLES = 0.65  # share of the pictures
SLENDER = 0.35  # share of the moving objects
POOR = 0.5  # share of the pictures with poor textures
CANDIDATES = 40  # of a search
SEEN = 0.1  # share of an object that must be visible
CASES = 3  # single images of each cluster beside a moving object
SEARCH = TrackerConfig(
    detection=DetectorConfig(
        stages=((CANDIDATES, 1),), half_turns=0, match=MatchConfig(more_places=0)
    ),
    contour=ContourConfig(enabled=False),
)  # whose candidates are refined here
NOISE = (1.0, 5.0)  # grey levels
BLUR = (0.3, 1.0)  # pixels
BATCH = 16  # loops side by side


@dataclass(frozen=True)
class Task:
    """One picture: its number, files of meshes and photographs to take from, and the weights."""

    number: int
    meshes: tuple[Path, ...]
    photos: tuple[Path, ...]
    weights: Path


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
            logits, confidence, attention, delta = self.network.folded(*parts)
        self.poses += [state.pose[row] for row in range(len(observation))]
        rows = zip(state.target.tolist(), self._told, confidence.tolist(), strict=True)
        self.seen += list(rows)
        return PolicyOutput(logits, delta, confidence, attention)

    def forget(self) -> None:
        """What was remembered."""
        self.poses, self.seen = [], []


@dataclass(frozen=True)
class Target:
    """An object in a picture: its mesh as the network has it, and its true pose."""

    mesh: Mesh
    truth: Pose


def outcomes_of(task: Task) -> Outcomes | None:
    """What came of one picture; None if nothing can be seen in it."""
    torch.set_num_threads(1)
    rng = np.random.default_rng([task.number, 6])
    photos = [read_image(path) for path in task.photos]
    loaded = load_network(task.weights).network
    assert isinstance(loaded, CompactCorrelationNet), "only a compact network is fitted"
    recorder, renderer = Recorder(loaded), make_renderer()
    found: list[Outcomes] = []
    if rng.random() < TABLES:
        image, camera, targets = table(rng, task.meshes, photos)
    else:
        mesh = Mesh.load(task.meshes[0], allow_flat=True)
        if rng.random() < SLENDER:
            mesh = slender_copy(rng, mesh)
        image, camera, targets = moving(rng, mesh, photos)
        found += _cases(rng, mesh, photos, recorder, renderer, task.number)
    if rng.random() < POOR:
        image = _spoilt_picture(rng, image)
        targets = [replace(one, mesh=_spoilt(rng, one.mesh)) for one in targets]
    frame = prepare_frame(image, camera)
    for target in targets:
        searched = candidates(frame, target.mesh, recorder, renderer)
        starts = [*searched, *near_starts(rng, target)]
        found.append(
            _refined(frame, target, starts, len(searched), recorder, renderer, task.number)
        )
    return Outcomes.joined(found) if found else None


def table(
    rng: np.random.Generator, paths: Sequence[Path], photos: Sequence[NDArray[np.uint8]]
) -> tuple[NDArray[np.uint8], Camera, list[Target]]:
    """Objects around another one, small in a photograph."""
    meshes: list[Mesh] = []
    for path in paths:
        mesh = Mesh.load(path, allow_flat=True)
        if sorted(np.ptp(mesh.vertices, 0))[1] / mesh.diameter > FLATTEST:
            meshes.append(of_size(mesh, rng.uniform(*SIZES)))
        if len(meshes) == OTHERS + 1:
            break
    scene = Scene(meshes[0], int(rng.integers(1 << 31)), FRAMES, "easy", photos, others=meshes[1:])
    seen = scene.render_frame(FRAMES // 2)
    photo = photos[int(rng.integers(len(photos)))]
    image, camera = within_photo(rng, seen.image, scene.camera, photo)
    every = [(meshes[0], seen.pose, seen.visible_fraction)]
    others = zip(scene.others, seen.others, strict=True)
    every += [(one.mesh, pose, share) for one, (pose, share) in others]
    targets = [Target(mesh, pose) for mesh, pose, share in every if share >= SEEN]
    return image, camera, [one for one in targets if _is_inside(one, camera)]


def moving(
    rng: np.random.Generator, mesh: Mesh, photos: Sequence[NDArray[np.uint8]]
) -> tuple[NDArray[np.uint8], Camera, list[Target]]:
    """One object in a frame of a clip."""
    level = str(rng.choice(["occ", "fast", "hard", "hard"]))
    scene = Scene(mesh, int(rng.integers(1 << 31)), FRAMES, level, photos)
    seen = scene.render_frame(int(rng.integers(FRAMES)))
    return seen.image, scene.camera, [Target(mesh, seen.pose)]


def within_photo(
    rng: np.random.Generator, image: NDArray[np.uint8], camera: Camera, photo: NDArray[np.uint8]
) -> tuple[NDArray[np.uint8], Camera]:
    """The picture, smaller, somewhere in a photograph of its size; its camera there."""
    height, width = image.shape[:2]
    factor = rng.uniform(0.45, 0.9)
    inner = round(width * factor), round(height * factor)
    left, top = (int(rng.integers(0, b - a)) for a, b in zip(inner, (width, height), strict=True))
    whole = cv2.resize(photo, (width, height), interpolation=cv2.INTER_AREA)
    small = cv2.resize(image, inner, interpolation=cv2.INTER_AREA)
    whole[top : top + inner[1], left : left + inner[0]] = small
    x, y = inner[0] / width, inner[1] / height
    middle = (camera.cx + 0.5) * x - 0.5 + left, (camera.cy + 0.5) * y - 0.5 + top
    return whole.astype(np.uint8), Camera(camera.fx * x, camera.fy * y, *middle, width, height)


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
    turned = half_turned(target.mesh, true)
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


def _is_inside(target: Target, camera: Camera) -> bool:
    """Whether the middle of the object is in the picture."""
    u, v = camera.project(target.mesh.inner(target.truth).translation.double()).tolist()
    return bool(0 <= u < camera.width and 0 <= v < camera.height)


def _spoilt(rng: np.random.Generator, mesh: Mesh) -> Mesh:
    """The mesh with blurred colours of less contrast and of another light."""
    contrast, tint = rng.uniform(0.45, 0.85), 1 + rng.uniform(-0.25, 0.25, 3)

    def dull(colours: NDArray[np.uint8]) -> NDArray[np.uint8]:
        values = colours[..., :3].astype(np.float64)
        mean = values.reshape(-1, 3).mean(0)
        dulled: NDArray[np.uint8] = np.clip(
            ((values - mean) * contrast + mean) * tint, 0, 255
        ).astype(np.uint8)
        return dulled

    texture, vertices = mesh.texture, mesh.vertex_colors
    if texture is not None:
        sigma = max(texture.shape) / rng.uniform(90, 400)
        return Mesh.from_arrays(
            mesh.name, mesh.vertices, mesh.faces, uv=mesh.uv,
            texture=dull(cv2.GaussianBlur(texture, (0, 0), sigma).astype(np.uint8)),
        )  # fmt: skip
    if vertices is not None:
        return Mesh.from_arrays(mesh.name, mesh.vertices, mesh.faces, vertex_colors=dull(vertices))
    return mesh


def _spoilt_picture(rng: np.random.Generator, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The picture, blurred a little, with noise."""
    soft = cv2.GaussianBlur(image, (0, 0), rng.uniform(*BLUR))
    noise = rng.normal(0, rng.uniform(*NOISE), image.shape)
    spoilt: NDArray[np.uint8] = np.clip(soft + noise, 0, 255).astype(np.uint8)
    return spoilt
