"""Single images: from a pose that is roughly right to one that fits.

Never remembers anything between two calls.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ..config import ActionMode, LoopConfig, TrackerConfig
from ..frame import Frame, prepare_frame
from ..geometry.camera import Camera
from ..geometry.crop import PATCH_SIZE
from ..geometry.mesh import Mesh
from ..geometry.pose import Pose
from ..policies import DihedralAugmentation, NetworkPolicy, Policy, mode_of
from ..rendering.renderer import Renderer
from ..threads import checked_threads, with_own_threads
from ..typing import ImageLike
from .contour_stage import refine_result
from .final_confidence import with_both_confidences
from .inputs import camera_of, config_of, meshes_of, policy_of, pose_of, renderer_of
from .multi_start import refine_multi_start
from .refine import once_more
from .results import Refined, Start, Target, TrackingResult, starts_of
from .visibility import check_start

DEFAULT = TrackerConfig()


class PoseEstimator:
    """Refines poses of one object seen by one camera.

    Args:
        mesh: the object.
        camera: the camera, lens distortion included if it has any.
        policy: predicts the pose deltas; the shipped network if None.
        renderer: the back end; embree if None.
        config: every other setting.
        threads: CPU threads of torch and OpenCV while it computes; the caller's if None. More than
            one gain little and lose much beside other busy processes.

    Example:
        >>> import numpy as np
        >>> from moveit6d import Camera, Mesh, OraclePolicy, Pose, PoseEstimator
        >>> corners = [[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]]
        >>> mesh = Mesh.from_arrays("corner", corners, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
        >>> camera = Camera(300, 300, 159.5, 119.5, 320, 240)
        >>> image = np.zeros((240, 320, 3), np.uint8)
        >>> truth = Pose.from_rvec([0, 0, 0], [0.01, 0, 0.5])
        >>> start = Pose.from_rvec([0, 0, 0], [0, 0, 0.5])
        >>> policy = OraclePolicy(Pose.stack([mesh.inner(truth)]))  # knows the answer
        >>> result = PoseEstimator(mesh, camera, policy=policy).refine(image, start)
        >>> result.stopped_by.value, result.confidence
        ('stop_action', 1.0)
    """

    def __init__(
        self,
        mesh: Mesh,
        camera: Camera,
        *,
        policy: Policy | None = None,
        renderer: Renderer | None = None,
        config: TrackerConfig = DEFAULT,
        threads: int | None = 1,
    ) -> None:
        self.mesh, self.camera = meshes_of([mesh])[0], camera_of(camera)
        self.config = config_of(config)
        self.threads = checked_threads(threads)
        self.policy: Policy = policy_of(policy)
        self.renderer = renderer_of(renderer)

    @with_own_threads
    def refine(self, image: ImageLike | Frame, pose: Pose) -> TrackingResult:
        """The pose in an RGB image (H, W, 3) near `pose`; both in the mesh file's frame.

        Raises `InputError` if the image does not fit the camera or the camera cannot see the object
        at that pose.
        """
        frame, pose = prepare_frame(image, self.camera), pose_of(pose)
        check_start(pose, self.mesh, frame.camera)
        target = Target(frame, self.camera, self.mesh, pose)
        return refine_single(
            [target], policy=self.policy, renderer=self.renderer, config=self.config
        )[0]


def refine_single(
    targets: Sequence[Target],
    *,
    policy: Policy,
    renderer: Renderer,
    config: TrackerConfig = DEFAULT,
) -> list[TrackingResult]:
    """`PoseEstimator.refine` for many targets at once, of any objects and images.

    A target whose object the camera cannot see gives a failed result. After the loop a policy of
    all axes makes one more iteration with test-time augmentation: a video has other frames to
    average over, a single image has not. `confidence` is by `SingleImageConfig`.
    """
    starts = starts_of(targets)
    refined = refine_multi_start(starts, policy=policy, renderer=renderer, config=config)
    if config.loop.augment and mode_of(policy, config.loop.mode) is ActionMode.ALL_AXES:
        refined = _augmented(starts, refined, policy, renderer, config.loop)
    refined = [
        refine_result(start.frame, start.mesh, one, renderer, config.contour)[0]
        for start, one in zip(starts, refined, strict=True)
    ]
    refined = with_both_confidences(
        starts, refined, policy=policy, renderer=renderer, config=config
    )
    return [one.result(start.mesh) for start, one in zip(starts, refined, strict=True)]


def _augmented(
    starts: Sequence[Start],
    results: Sequence[Refined],
    policy: Policy,
    renderer: Renderer,
    loop: LoopConfig,
) -> list[Refined]:
    """The results after one augmented iteration each; one that fails then stays as it was.

    Compact networks are shown larger crops (`LoopConfig.augment_size`), but the confidence is that
    of usual ones: it is a probability where it sees what it was trained with.
    """
    found, views = list(results), DihedralAugmentation(policy)
    larger = isinstance(policy, NetworkPolicy) and policy.takes_larger_crops
    size = loop.augment_size if larger else PATCH_SIZE
    usual = once_more(starts, results, policy=views, renderer=renderer, loop=loop)
    moved = usual
    if size != PATCH_SIZE:
        moved = once_more(starts, results, policy=views, renderer=renderer, loop=loop, size=size)
    for i, last in moved.items():
        if last.centred is not None:
            spent = last.milliseconds + (0.0 if last is usual[i] else usual[i].milliseconds)
            found[i] = replace(
                found[i],
                centred=last.centred,
                confidence=usual[i].confidence,
                iterations=found[i].iterations + 1,
                milliseconds=found[i].milliseconds + spent,
            )
    return found
