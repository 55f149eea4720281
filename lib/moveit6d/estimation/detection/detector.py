"""An object's pose in a single image from nothing, or from what is known: search, refine, verify.

Never remembers anything of an image. Template matching over the whole image proposes candidates; a
tournament of the refinement loop chooses between them; verification says whether one is there.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import replace
from typing import Any, Literal

import torch

from ...checks import whole
from ...config import ActionMode, SeedDetectorConfig, TrackerConfig
from ...errors import InputError
from ...frame import Frame, prepare_frame
from ...geometry.camera import Camera
from ...geometry.mesh import Mesh
from ...geometry.pose import Pose
from ...policies import DescriptorPolicy, NetworkPolicy, Policy, mode_of, search_policy
from ...rendering.renderer import Renderer
from ...threads import checked_threads, limited_threads, with_own_threads
from ...typing import ImageLike
from ..contour_stage import refine_result
from ..half_turns import half_turned
from ..inputs import camera_of, config_of, meshes_of, policy_of, pose_of, renderer_of
from ..refine import refine_starts
from ..results import Refined, Start
from ..seed_detector import SeedDetection, SeedDetector
from ..seeding import seed_poses
from ..visibility import start_problem
from .agreement import disagreement, given_poses
from .found import Detection, FoundPose
from .instances import first_of_instances, is_same_instance
from .proposals import Proposals
from .pyramid import Pyramid
from .region import SearchRegion
from .steps import Steps, finish
from .templates import TemplateBank, TemplateStore
from .verification import Evidence, similarities
from .views import Candidates

# Iterations in a step, of loops that run side by side. Few, because a search under a time limit
# goes on step by step.
STEP_ITERATIONS = 10

DEFAULT, DEFAULT_SEEDS = TrackerConfig(), SeedDetectorConfig()

Method = Literal["templates", "seeds"]


class PoseDetector:
    """Finds one object in single images of one camera, without a start pose.

    Args:
        mesh: the object; it is prepared once, in a second or two, at the first image.
        camera: the camera, lens distortion included if it has any.
        policy: refines and describes; the shipped network if None.
        renderer: the back end; embree if None.
        config: every other setting; of a search those in `detection`.
        method: templates compares the image with the object seen from all sides; seeds is the
            paper's way, by where single iterations lead: it takes minutes, and the object to be
            there.
        seeds: settings of the method seeds.
        store: where prepared meshes are kept; in memory of this detector alone if None.
        threads: CPU threads of torch and OpenCV while it computes; the caller's if None.

    Raises `InputError` for a policy without descriptors, unless the method is seeds.
    """

    def __init__(
        self,
        mesh: Mesh,
        camera: Camera,
        *,
        policy: Policy | None = None,
        renderer: Renderer | None = None,
        config: TrackerConfig = DEFAULT,
        method: Method = "templates",
        seeds: SeedDetectorConfig = DEFAULT_SEEDS,
        store: TemplateStore | None = None,
        threads: int | None = 1,
    ) -> None:
        self.mesh, self.camera = meshes_of([mesh])[0], camera_of(camera)
        self.settings, self.config = config_of(config), config.detection
        self.threads = checked_threads(threads)
        self.renderer = renderer_of(renderer)
        self.store = store or TemplateStore()
        self._policy: Policy = policy_of(policy)
        self.seeds: SeedDetector | None = None
        if method == "seeds":
            self.seeds = SeedDetector(
                self.mesh, self.camera, policy=self._policy, renderer=self.renderer, config=seeds,
                threads=threads,
            )  # fmt: skip
        elif method != "templates":
            raise InputError(f"There is no method {method!r}; choose one of templates, seeds.")
        elif not isinstance(self._policy, DescriptorPolicy):
            raise InputError(
                f"{type(self._policy).__name__} has no descriptors to search an image with; use "
                "method='seeds', or a network that has them."
            )

    @property
    def policy(self) -> DescriptorPolicy:
        """The policy as the method templates needs it."""
        assert isinstance(self._policy, DescriptorPolicy)
        return self._policy

    @with_own_threads
    def prepare(self) -> TemplateBank:
        """Describe the mesh from all sides, unless that has been done before."""
        policy, settings = self.policy, self.config.templates
        name = _name_of(policy)
        return self.store.get(self.mesh, policy.descriptors, self.renderer, settings, name)

    def is_taken(self, centred: Pose, taken: Sequence[Pose]) -> bool:
        """Whether a centred pose is the instance of one of `taken` (mesh file's frame)."""
        return any(
            is_same_instance(
                self.mesh, self.camera, centred, self.mesh.inner(one), self.config.same_instance
            )
            for one in taken
        )

    @with_own_threads
    def detect(
        self,
        image: ImageLike | Frame,
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
        image as it was taken. `instances` is how many of the object there may be. A pose that does
        not agree with what is known is not found. The method `seeds` takes none of these.

        Raises `InputError` if something given cannot be used, or contradicts the rest.
        """
        frame = prepare_frame(image, self.camera)
        if whole(instances, "instances") < 1:
            raise InputError(f"instances must be 1 or more, found {instances}.")
        near = None if start is None else pose_of(start)
        region = SearchRegion.checked(self.camera, box, mask, distance, near)
        if self.seeds is not None:
            if not region.empty or points is not None or instances != 1:
                raise InputError(
                    "The method seeds looks for one object in the whole image; leave out what "
                    "narrows it."
                )
            return _by_seeds(self.seeds.detect(frame))
        known = self.config.region
        region.check_common(known)
        region = region.undistorted(self.camera)
        given = given_poses(region, self.mesh, self.camera, points, instances, known)
        return finish(self.steps(frame, region, given, instances, search=points is None))

    def steps(
        self,
        image: ImageLike | Frame,
        region: SearchRegion | None = None,
        given: Sequence[Pose] = (),
        instances: int = 1,
        search: bool = True,
        pyramid: Pyramid | None = None,
        most: int | None = None,
    ) -> Steps:
        """`detect` in short steps, for who has other things to do between them; by templates.

        `region` is one of the image without its lens. `given` are poses (mesh file's frame) that
        are tried beside the candidates of the search, or instead of them. Each `next` does one step
        of ten milliseconds to a tenth of a second; the generator's value is the detection.
        Detectors of several objects may share the `pyramid` of an image (`pyramid_of`). With `most`
        no more than so many poses are looked at, at the first places only.
        """
        frame = prepare_frame(image, self.camera).undistorted
        known = region or SearchRegion()
        poses = [self.mesh.inner(pose.to(torch.float64)) for pose in given]
        poses = [pose for pose in poses if self._in_sight(pose, self.camera)]
        stages = self.config.stages if known.bounds is None else self.config.region.stages
        count, proposals = stages[0][0] * instances, None
        if search:
            proposals = Proposals(
                self.mesh, self.camera, self.prepare(),
                self.pyramid_of(frame) if pyramid is None else pyramid, known, self.config,
            )  # fmt: skip
            yield
            poses += self._poses((yield from proposals.first(count)), frame.camera)
        looked_at = yield from self._looked_at(frame, poses[:most], stages, instances, known)
        found = self._answer(looked_at, instances)
        enough = len(found.instances) >= instances or not self.config.match.more_places
        if proposals is None or most is not None or enough:
            return found
        poses = self._poses((yield from proposals.half_occluded(count)), frame.camera)
        looked_at += yield from self._looked_at(frame, poses, stages, instances, known)
        return self._answer(looked_at, instances)

    def _looked_at(
        self,
        frame: Frame,
        poses: Sequence[Pose],
        stages: Sequence[tuple[int, int]],
        instances: int,
        known: SearchRegion,
    ) -> Generator[None, None, list[FoundPose]]:
        """Where the best of centred poses lead, and how likely that is right.

        Without what does not agree with what is known.
        """
        refined = yield from self._tournament(frame, poses, stages, instances, known.taken)
        found = self._verified(frame, [one for one in refined if self._agrees(frame, one, known)])
        yield
        return found

    def pyramid_of(self, frame: Frame) -> Pyramid:
        """The frame at all scales, without its lens, described by this detector's policy."""
        return Pyramid(frame.undistorted, self.policy.descriptors, self.config.templates)

    def _in_sight(self, centred: Pose, camera: Camera) -> bool:
        return start_problem(centred, self.mesh, camera) is None

    def _poses(self, candidates: Candidates, camera: Camera) -> list[Pose]:
        """Centred poses of candidates that the camera can see."""
        rotations = self.prepare().fine.rotations[candidates.views]
        pixels, widths = candidates.pixels.to(torch.float64), candidates.widths
        poses = seed_poses(pixels, rotations, self.mesh.sphere_diameter, widths, camera)
        every = (poses[k] for k in range(len(candidates)))
        return [pose for pose in every if self._in_sight(pose, camera)]

    def _tournament(
        self,
        frame: Frame,
        poses: Sequence[Pose],
        stages: Sequence[tuple[int, int]],
        instances: int,
        taken: Sequence[Pose] = (),
    ) -> Generator[None, None, list[Refined]]:
        """Refine centred candidates in rounds, fewer and longer each time; the best at the end.

        In the last round the best one starts turned by half, too, as cartons are found. What gets
        to an instance that is `taken` is out.
        """
        results: list[Refined] = []
        for number, (count, iterations) in enumerate(stages):
            if number:
                best = _most_confident(results, count * instances)
                poses = [one.centred for one in best if one.centred is not None]
            if number and number == len(stages) - 1:
                turned = poses[: instances * self.config.half_turns]
                poses = [*poses, *(pose for one in turned for pose in half_turned(self.mesh, one))]
            results = []
            loop = replace(self.settings.loop, max_iterations=iterations)
            batch = max(2, STEP_ITERATIONS // iterations)
            for first in range(0, len(poses), batch):
                some = poses[first : first + batch]
                ends = refine_starts(
                    [Start(frame, self.mesh, pose) for pose in some],
                    policy=search_policy(self.policy),
                    renderer=self.renderer,
                    loop=loop,
                    targets=[0] * len(some),
                )
                results += [
                    one
                    for one in ends
                    if one.centred is None or not self.is_taken(one.centred, taken)
                ]
                yield
        return results

    def _agrees(self, frame: Frame, result: Refined, known: SearchRegion) -> bool:
        """Whether a pose was found that agrees with what is known."""
        if result.centred is None:
            return False
        config = self.config.region
        return disagreement(known, self.mesh, frame.camera, result.centred, config=config) is None

    def _verified(self, frame: Frame, results: Sequence[Refined]) -> list[FoundPose]:
        """Of each place the most confident pose: fit its contour, and verify it.

        Poses of one place are views of one thing: there the confidence alone decides, which knows
        half turns apart that agree with the image as well.
        """
        ranked = _most_confident(results, len(results))
        kept = self._first_of_places([one.centred for one in ranked if one.centred is not None])
        refined = [
            refine_result(frame, self.mesh, ranked[k], self.renderer, self.settings.contour)[0]
            for k in kept
        ]
        poses = [one.centred for one in refined if one.centred is not None]
        cosines = similarities(frame, self.mesh, poses, self.policy, self.renderer)
        found = []
        for one, cosine in zip(refined, cosines, strict=True):
            evidence = Evidence(one.confidence, cosine)
            probability = evidence.probability(self.config.verification)
            result = replace(one, confidence=probability).result(self.mesh)
            found.append(FoundPose(result, evidence))
        return found

    def _answer(self, found: Sequence[FoundPose], instances: int) -> Detection:
        """Which of the poses are right, as many as there may be instances; one of each place."""
        ranked = sorted(found, key=lambda one: -one.evidence.confidence if one.evidence else 0)
        kept = self._first_of_places([self.mesh.inner(one.pose) for one in ranked])
        apart = sorted((ranked[k] for k in kept), key=lambda one: -one.probability)
        accepted = [one for one in apart if one.probability >= self.config.accepted][:instances]
        rest = [one for one in apart if not any(one is other for other in accepted)]
        return Detection(tuple(accepted), tuple(rest))

    def _first_of_places(self, centred: Sequence[Pose]) -> list[int]:
        """Indices of those centred poses, the best first, that are the first of their place."""
        return first_of_instances(self.mesh, self.camera, centred, self.config.same_instance)


def _name_of(policy: DescriptorPolicy) -> str:
    """What tells a policy's descriptors from those of others; empty if nothing does."""
    source = str(getattr(policy, "source", None) or "")
    if not source or not isinstance(policy, NetworkPolicy):
        return source
    return f"{source} {'bfloat16' if policy.network.is_bfloat16 else 'float32'}"


def _most_confident(results: Sequence[Refined], count: int) -> list[Refined]:
    """The most confident results that have a pose."""
    alive = [result for result in results if result.centred is not None]
    return sorted(alive, key=lambda one: -one.confidence)[:count]


def _by_seeds(found: SeedDetection) -> Detection:
    """What the paper's way found; the confidence is all that it knows."""
    result = found.result
    if result is None or result.pose is None:
        return Detection((), seeds=found)
    return Detection((FoundPose(result),), seeds=found)


def can_search(policy: Policy, config: TrackerConfig) -> bool:
    """Whether a lost object is looked for: with `recovery`, descriptors and all axes at once."""
    single = mode_of(policy, config.loop.mode) is ActionMode.SINGLE
    return config.recovery.enabled and isinstance(policy, DescriptorPolicy) and not single


def detect_objects(
    detectors: Sequence[PoseDetector],
    image: ImageLike | Frame,
    counts: Sequence[int] | None = None,
    regions: Sequence[SearchRegion] | None = None,
) -> list[Detection]:
    """Several objects in one image, each with its own detector of one policy and camera.

    The image is described once for all of them, with the threads of the first. `counts` are the
    most instances of each (one), `regions` say where each is looked for.

    Raises `InputError` for what `PoseDetector.detect` refuses, and for the method seeds.

    Example:
        >>> import torch
        >>> from moveit6d import Camera, Mesh, PoseDetector, TrackerConfig, detect_objects
        >>> from moveit6d import load_policy
        >>> from moveit6d.config import DetectorConfig, TemplateConfig
        >>> corners = torch.tensor([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]])
        >>> sides = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
        >>> meshes = [Mesh.from_arrays("corner", size * corners, sides) for size in (1, 2)]
        >>> camera, policy = Camera(80, 80, 39.5, 31.5, 80, 64), load_policy()
        >>> few = TemplateConfig(rotations=40, coarse_rotations=20)  # quick, but rough
        >>> config = TrackerConfig(detection=DetectorConfig(templates=few, stages=((2, 1),)))
        >>> tools = {"policy": policy, "config": config}
        >>> detectors = [PoseDetector(mesh, camera, **tools) for mesh in meshes]
        >>> [one.found for one in detect_objects(detectors, torch.zeros(3, 64, 80))]
        [False, False]
    """
    if not detectors:
        return []
    if any(one.seeds is not None for one in detectors):
        raise InputError("detect_objects is for the method templates, found one of seeds.")
    for name, given in (("counts", counts), ("regions", regions)):
        if given is not None and len(given) != len(detectors):
            raise InputError(f"{name}: {len(detectors)} are needed, found {len(given)}.")
    frame = prepare_frame(image, detectors[0].camera)
    with limited_threads(detectors[0].threads):
        pyramid = detectors[0].pyramid_of(frame)
    numbers = [1] * len(detectors) if counts is None else list(counts)
    known = [SearchRegion()] * len(detectors) if regions is None else list(regions)
    found = []
    for detector, count, region in zip(detectors, numbers, known, strict=True):
        with limited_threads(detector.threads):
            seen = region.undistorted(detector.camera)
            steps = detector.steps(frame, seen, instances=count, pyramid=pyramid)
            found.append(finish(steps))
    return found
