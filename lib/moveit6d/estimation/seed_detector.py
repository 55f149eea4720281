"""The pose of an object in one frame without any start: seeds, sinks, a coarse rotation grid.

Never needs another network or a true pose. Paper, "Initialization & Detection"; docs/method.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from ..actions import pose_delta
from ..config import MAX_ITERATIONS, ActionMode, SeedDetectorConfig, SelectionCriterion
from ..frame import Frame, prepare_frame
from ..geometry.camera import Camera
from ..geometry.mesh import Mesh
from ..geometry.pose import Pose
from ..geometry.rotation import random_rotations
from ..geometry.rotation_grid import rotation_grid
from ..policies import BATCH_SIZE, Policy
from ..rendering.renderer import Renderer
from ..threads import checked_threads, with_own_threads
from ..typing import ImageLike
from .inputs import camera_of, meshes_of, policy_of, renderer_of
from .refine import refine_batch
from .results import StopReason, Target, TrackingResult
from .seeding import SeedField, Sink, find_sinks, seed_field, seed_poses

DEFAULT = SeedDetectorConfig()


@dataclass(frozen=True)
class Candidate:
    """A pose of the rotation grid and where the loop took it.

    `start` is in the mesh file's frame; `path_length` the sum of the absolute pose delta from start
    to end, which is how many single actions it amounts to (infinite without a pose).
    """

    sink: Sink
    start: Pose
    result: TrackingResult
    path_length: float

    @property
    def converged(self) -> bool:
        """Whether the loop ended by itself."""
        return self.result.stopped_by in (StopReason.STOP_ACTION, StopReason.REVISITED)


@dataclass(frozen=True)
class SeedDetection:
    """What was found: the best candidate's result (None if no candidate has a pose), and how.

    `pose` is in the mesh file's frame; `fields` are those of the sizes that were tried; `places`
    the ones looked into, the strongest first, each with its sinks of one or more sizes;
    `candidates` all poses of the grids at them.
    """

    result: TrackingResult | None
    fields: tuple[SeedField, ...]
    places: tuple[tuple[Sink, ...], ...]
    candidates: tuple[Candidate, ...]

    @property
    def pose(self) -> Pose | None:
        """The pose found."""
        return None if self.result is None else self.result.pose


class SeedDetector:
    """Finds one object in single images of one camera in the paper's way.

    Args:
        mesh: the object.
        camera: the camera, lens distortion included if it has any.
        policy: predicts the pose deltas; the shipped network if None.
        renderer: the back end; embree if None.
        config: every other setting.
        threads: CPU threads of torch and OpenCV while it computes; the caller's if None. More than
            one gain little and lose much beside other busy processes.
    """

    def __init__(
        self,
        mesh: Mesh,
        camera: Camera,
        *,
        policy: Policy | None = None,
        renderer: Renderer | None = None,
        config: SeedDetectorConfig = DEFAULT,
        threads: int | None = 1,
    ) -> None:
        self.mesh, self.camera = meshes_of([mesh])[0], camera_of(camera)
        self.config, self.loop, self.threads = config, config.loop, checked_threads(threads)
        self.criterion = SelectionCriterion(config.criterion)
        if config.loop.max_iterations is None and self.criterion is SelectionCriterion.ITERATIONS:
            limit = MAX_ITERATIONS[ActionMode.SINGLE]
            self.loop = replace(config.loop, max_iterations=limit)
        self.policy: Policy = policy_of(policy)
        self.renderer = renderer_of(renderer)

    @with_own_threads
    def detect(self, image: ImageLike | Frame) -> SeedDetection:
        """The object in an RGB image (H, W, 3); it is taken to be there.

        Raises `InputError` if the image does not fit the camera.
        """
        frame = prepare_frame(image, self.camera).undistorted
        fields = self.seed(frame)
        config = self.config
        found = [s for field in fields for s in find_sinks(field, 2 * config.sinks, config)]
        places = strongest(found, config.sinks, config.same_place)
        candidates = self.try_rotations(frame, [sink for place in places for sink in place])
        best = best_of(candidates, self.criterion)
        return SeedDetection(None if best is None else best.result, fields, places, candidates)

    @with_own_threads
    def seed(self, image: ImageLike | Frame) -> tuple[SeedField, ...]:
        """The fields of one iteration from seeds all over the image, one a size."""
        frame = prepare_frame(image, self.camera).undistorted
        generator = torch.Generator().manual_seed(self.config.seed)
        turns = random_rotations(self.config.poses, generator)
        side = min(self.camera.width, self.camera.height)
        return tuple(
            seed_field(
                frame, self.mesh, turns, share * side, self.policy, self.renderer, self.config
            )
            for share in self.config.sizes
        )

    @with_own_threads
    def try_rotations(
        self, image: ImageLike | Frame, sinks: Sequence[Sink]
    ) -> tuple[Candidate, ...]:
        """Loops from a coarse grid over all rotations at every sink, in batches."""
        frame = prepare_frame(image, self.camera).undistorted
        grid = rotation_grid(self.config.rotations)
        starts = [(sink, pose) for sink in sinks for pose in self._poses(sink, grid, frame)]
        found = []
        for begin in range(0, len(starts), BATCH_SIZE):
            part = starts[begin : begin + BATCH_SIZE]
            results = refine_batch(
                [Target(frame, self.camera, self.mesh, self.mesh.outer(pose)) for _, pose in part],
                policy=self.policy,
                renderer=self.renderer,
                loop=self.loop,
            )
            found += [
                Candidate(sink, self.mesh.outer(pose), result, self._path_length(pose, result))
                for (sink, pose), result in zip(part, results, strict=True)
            ]
        return tuple(found)

    def _poses(self, sink: Sink, grid: Tensor, frame: Frame) -> list[Pose]:
        pixels = sink.centre.expand(len(grid), 2)
        poses = seed_poses(pixels, grid, self.mesh.sphere_diameter, sink.size, frame.camera)
        return [poses[k] for k in range(len(grid))]

    def _path_length(self, start: Pose, result: TrackingResult) -> float:
        if result.pose is None:
            return float("inf")
        diameter = torch.tensor(self.mesh.sphere_diameter, dtype=torch.float64)
        delta = pose_delta(start, self.mesh.inner(result.pose), diameter)
        return float(delta.abs().sum())


def strongest(
    sinks: Sequence[Sink], count: int, same_place: float = DEFAULT.same_place
) -> tuple[tuple[Sink, ...], ...]:
    """The places of the `count` strongest sinks, each with all sinks that are there.

    Sinks nearer than `same_place` widths of the object are at one place.
    """
    places: list[list[Sink]] = []
    for sink in sorted(sinks, key=lambda one: -one.strength):
        for place in places:
            limit = same_place * max(sink.size, place[0].size)
            if float((sink.centre - place[0].centre).norm()) < limit:
                place.append(sink)
                break
        else:
            places.append([sink])
    return tuple(tuple(place) for place in places[:count])


def best_of(candidates: Sequence[Candidate], criterion: SelectionCriterion) -> Candidate | None:
    """The best candidate that has a pose, by the criterion; None if there is none."""
    alive = [one for one in candidates if one.result.pose is not None]
    if not alive:
        return None
    if criterion is SelectionCriterion.CONFIDENCE:
        return max(alive, key=lambda one: one.result.confidence)
    return min(alive, key=lambda one: (not one.converged, one.result.iterations, one.path_length))
