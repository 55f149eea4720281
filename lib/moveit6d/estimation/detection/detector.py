"""An object's pose in a single image from nothing, or from what is known: search, refine, judge.

Never remembers anything of an image. Template matching over the whole image proposes candidates; a
tournament of the refinement loop chooses between them; a judge says whether the object is there.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch

from ...errors import InputError
from ...geometry.camera import Camera
from ...geometry.mesh import Mesh
from ...geometry.pose import Pose
from ...policies import DescriptorPolicy, Policy, load_policy
from ...rendering.renderer import Renderer, make_renderer
from ..contour_stage import refine_result
from ..frame import Frame, prepare_frame
from ..refine import Target, TrackingResult, check_start, out_of_sight, refine_batch
from ..seeding import seed_poses
from .config import DetectorConfig
from .judge import Evidence, similarities
from .matching import Candidates, Matcher, Pyramid, ladder
from .points import poses_from_points
from .region import SearchRegion
from .templates import WIDTH, TemplateBank, TemplateStore

BATCH = 8  # loops that run side by side: a step of a search under a time limit is one batch
BACKGROUND = 0.6  # scale of the whole image in which a narrowed search learns what is usual
SAME_INSTANCE = 0.4  # of the object's width: nearer poses are one instance

Steps = Generator[None, None, "Detection"]


@dataclass(frozen=True)
class FoundPose:
    """One instance: the refined result, the probability that it is right, and what speaks for it.

    `result.pose` is in the mesh file's frame; `result.confidence` is the probability.
    """

    result: TrackingResult
    probability: float
    evidence: Evidence

    @property
    def pose(self) -> Pose:
        """Object → camera, in the mesh file's frame, metres."""
        assert self.result.pose is not None  # results without a pose are never kept
        return self.result.pose


@dataclass(frozen=True)
class Detection:
    """What was found of one object in one image, the most probable first.

    `instances` are those found; `rejected` the best of what was looked at and not accepted.
    """

    instances: tuple[FoundPose, ...]
    rejected: tuple[FoundPose, ...] = ()

    @property
    def found(self) -> bool:
        """Whether the object is in the image, as far as can be told."""
        return bool(self.instances)

    @property
    def best(self) -> FoundPose | None:
        """The most probable pose, accepted or not; None if nothing could be looked at."""
        every = (*self.instances, *self.rejected)
        return max(every, key=lambda one: one.probability) if every else None

    @property
    def pose(self) -> Pose | None:
        """The pose of the most probable instance; None if the object was not found."""
        return self.instances[0].pose if self.instances else None

    @property
    def probability(self) -> float:
        """That the best pose is right; 0 if there is none."""
        return 0.0 if self.best is None else self.best.probability


class PoseDetector:
    """Finds one object in single images of one camera, without a start pose.

    Args:
        mesh: the object; it is prepared once, in a second or two, at the first image.
        camera: the camera, lens distortion included if it has any.
        config: every setting.
        policy: refines and describes; the shipped network if None.
        renderer: the back end; embree if None.
        store: where prepared meshes are kept; in memory of this detector alone if None.

    Raises `InputError` for a policy without descriptors.
    """

    def __init__(
        self,
        mesh: Mesh,
        camera: Camera,
        *,
        config: DetectorConfig | None = None,
        policy: Policy | None = None,
        renderer: Renderer | None = None,
        store: TemplateStore | None = None,
    ) -> None:
        self.mesh, self.camera = mesh, camera
        self.config = config or DetectorConfig()
        chosen = load_policy() if policy is None else policy
        if not isinstance(chosen, DescriptorPolicy):
            raise InputError(
                f"{type(chosen).__name__} has no descriptors to search an image with; use "
                "SeedDetector, or a network that has them."
            )
        self.policy: DescriptorPolicy = chosen
        self.renderer = make_renderer() if renderer is None else renderer
        self.store = store or TemplateStore()

    def prepare(self) -> TemplateBank:
        """Describe the mesh from all sides, unless that has been done before."""
        network = str(getattr(self.policy, "source", ""))
        return self.store.get(
            self.mesh, self.policy.descriptors, self.renderer, self.config.templates, network
        )

    def detect(
        self,
        image: Any,
        *,
        instances: int = 1,
        box: Sequence[float] | None = None,
        mask: Any = None,
        points: Any = None,
        distance: Sequence[float] | None = None,
        start: Pose | None = None,
    ) -> Detection:
        """The object in an RGB image (H, W, 3); whether it is there is part of the answer.

        What is known narrows the search: `box` (x, y, width, height) in pixels around what is
        visible; `mask` (H, W), not zero on the object; `points` (N, 5) rows u, v, x, y, z of four
        or more pixels and where they lie on the mesh (its file's frame, metres); `distance`
        (nearest, farthest) metres; `start` a pose that is roughly right. Pixels are those of the
        image as it was taken. `instances` is how many of the object there may be.

        Raises `InputError` if something given cannot be used.
        """
        frame = prepare_frame(image, self.camera)
        region = SearchRegion.checked(self.camera, box, mask, distance, start)
        if start is not None:
            check_start(start, self.mesh, frame.camera)
        given = [] if start is None else [start]
        if points is not None:
            given += poses_from_points(points, self.camera)
        return finish(self.steps(frame, region, given, instances, search=points is None))

    def steps(
        self,
        image: Any,
        region: SearchRegion | None = None,
        given: Sequence[Pose] = (),
        instances: int = 1,
        search: bool = True,
        pyramid: Pyramid | None = None,
    ) -> Steps:
        """`detect` in short steps, for who has other things to do between them.

        `given` are poses that are tried beside the candidates of the search, or instead of them.
        Each `next` does one step of some ten milliseconds; the generator's value is the detection.
        Detectors of several objects may share the `pyramid` of an image (`pyramid_of`).
        """
        frame = prepare_frame(image, self.camera)
        known = region or SearchRegion()
        found = Detection(())
        poses = [pose for pose in given if self._in_sight(pose)]
        if search:
            levels = self.pyramid_of(frame) if pyramid is None else pyramid
            candidates = yield from self._search(frame, known, levels)
            poses += self._poses(candidates, frame.camera)
        size = self.config.match.candidates
        results: list[FoundPose] = []
        for first in range(0, len(poses), size):
            refined = yield from self._tournament(frame, poses[first : first + size], instances)
            results += self._judged(frame, refined)
            yield
            found = self._answer(results, instances)
            if len(found.instances) >= instances:
                break
        return found

    def pyramid_of(self, frame: Frame) -> Pyramid:
        """The frame at all scales, described by this detector's policy."""
        pixels = frame.pixels
        image = pixels if pixels.is_floating_point() else pixels.to(torch.float32) / 255
        return Pyramid(image, self.policy.descriptors, self.config.match.local_mean)

    def _search(
        self, frame: Frame, region: SearchRegion, pyramid: Pyramid
    ) -> Generator[None, None, Candidates]:
        """Candidates in the image, those first that match best."""
        bank, config = self.prepare(), self.config.match
        yield
        low, high = region.widths(self.mesh, frame.camera, config.widths)
        matcher = Matcher(bank, config, self.config.templates.colour)
        window = region.window(self.mesh, frame.camera, high)
        if window is not None:
            background = max(0.5 * (low + high), WIDTH / BACKGROUND)
            matcher.add(pyramid.level(background), background_only=True)
            yield
        for width in ladder(low, high, config.step):
            matcher.add(pyramid.level(width, window))
            yield
        allowed = None if region.empty else (
            lambda pixels, widths, views: region.allows(
                self.mesh, frame.camera, pixels, widths, bank.fine.boxes[views]
            )
        )  # fmt: skip
        return matcher.candidates(allowed)

    def _in_sight(self, pose: Pose) -> bool:
        centre = self.mesh.inner(pose.to(torch.float64)).translation
        return out_of_sight(centre, self.mesh.sphere_diameter, self.camera) is None

    def _poses(self, candidates: Candidates, camera: Camera) -> list[Pose]:
        """Poses (mesh file's frame) of candidates that the camera can see."""
        rotations = self.prepare().fine.rotations
        found = []
        for k in range(len(candidates)):
            pixel = candidates.pixels[k].to(torch.float64)[None]
            rotation = rotations[candidates.views[k]][None]
            diameter = self.mesh.sphere_diameter
            pose = seed_poses(pixel, rotation, diameter, float(candidates.widths[k]), camera)[0]
            if out_of_sight(pose.translation, diameter, camera) is None:
                found.append(self.mesh.outer(pose))
        return found

    def _tournament(
        self, frame: Frame, poses: Sequence[Pose], instances: int
    ) -> Generator[None, None, list[TrackingResult]]:
        """Refine the candidates in rounds, fewer and longer each time; the most confident last."""
        results: list[TrackingResult] = []
        for number, (count, iterations) in enumerate(self.config.stages):
            if number:
                poses = [r.pose for r in self._best(results, count * instances) if r.pose]
            results, current = [], list(poses)
            for first in range(0, len(current), BATCH):
                results += refine_batch(
                    [
                        Target(frame, self.camera, self.mesh, pose)
                        for pose in current[first : first + BATCH]
                    ],
                    policy=self.policy,
                    renderer=self.renderer,
                    max_iterations=iterations,
                )
                yield
        return results

    def _best(self, results: Sequence[TrackingResult], count: int) -> list[TrackingResult]:
        """The most confident results, each pose once."""
        ranked = sorted((r for r in results if r.pose is not None), key=lambda r: -r.confidence)
        return ranked[:count]

    def _judged(self, frame: Frame, results: Sequence[TrackingResult]) -> list[FoundPose]:
        """Fit the contours, and look at every pose once more."""
        alive = []
        for result in results:
            if result.pose is not None:
                target = Target(frame, self.camera, self.mesh, result.pose)
                alive.append(refine_result(target, result, self.renderer)[0])
        poses = [one.pose for one in alive if one.pose is not None]
        cosines = similarities(frame, self.mesh, poses, self.policy, self.renderer)
        found = []
        for result, cosine in zip(alive, cosines, strict=True):
            evidence = Evidence(result.confidence, cosine)
            probability = evidence.probability(self.config.judge)
            found.append(FoundPose(replace(result, confidence=probability), probability, evidence))
        return found

    def _answer(self, found: Sequence[FoundPose], instances: int) -> Detection:
        """Which of the poses are right, as many as there may be instances."""
        apart = self._apart(sorted(found, key=lambda one: -one.probability))
        accepted = [one for one in apart if one.probability >= self.config.accepted][:instances]
        rest = [one for one in apart if not any(one is kept for kept in accepted)]
        return Detection(tuple(accepted), tuple(rest))

    def _apart(self, found: Sequence[FoundPose]) -> list[FoundPose]:
        """The best pose of each place."""
        kept: list[FoundPose] = []
        for one in found:
            if not any(self._is_same(one.pose, other.pose) for other in kept):
                kept.append(one)
        return kept

    def _is_same(self, one: Pose, other: Pose) -> bool:
        a, b = self.mesh.inner(one).translation, self.mesh.inner(other).translation
        aside = (self.camera.project(a) - self.camera.project(b)).norm()
        width = self.camera.fx * self.mesh.sphere_diameter / float(torch.minimum(a[2], b[2]))
        return float(aside) < SAME_INSTANCE * width


def finish(steps: Steps) -> Detection:
    """Take the steps of a detection to their end."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            found: Detection = end.value
            return found


def detect_objects(
    detectors: Sequence[PoseDetector], image: Any, counts: Sequence[int] | None = None
) -> list[Detection]:
    """Several objects in one image, each with its own detector of one policy and camera.

    The image is described once for all of them. `counts` are the most instances of each.
    """
    if not detectors:
        return []
    frame = prepare_frame(image, detectors[0].camera)
    pyramid = detectors[0].pyramid_of(frame)
    numbers = [1] * len(detectors) if counts is None else list(counts)
    return [
        finish(detector.steps(frame, instances=count, pyramid=pyramid))
        for detector, count in zip(detectors, numbers, strict=True)
    ]


def default_store() -> Path:
    """Where the command line keeps prepared meshes: the user's cache folder."""
    import os

    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "moveit6d" / "templates"
