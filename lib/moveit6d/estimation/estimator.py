"""Single images: from a pose that is roughly right to one that fits.

Never remembers anything between two calls.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from ..geometry.camera import Camera
from ..geometry.mesh import Mesh
from ..geometry.pose import Pose
from ..policies import MoveMode, Policy, TurnedPolicy, load_policy
from ..rendering.renderer import Renderer, make_renderer
from ..threads import checked_threads, with_own_threads
from .frame import prepare_frame
from .inputs import camera_of, meshes_of, pose_of
from .last_word import last_word
from .loop import Target, TrackingResult, refine_batch
from .search import refine_or_search


class PoseEstimator:
    """Refines poses of one object seen by one camera.

    Args:
        mesh: the object.
        camera: the camera, lens distortion included if it has any.
        policy: who decides; the shipped network if None.
        renderer: the back end; embree if None.
        max_steps: limit of cycles; `MAX_STEPS` of the policy's mode if None.
        search: where the network does not believe its end, start from places around as well.
        regions: after the policy's moves, fit the outline to where the object's colours end.
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
        max_steps: int | None = None,
        search: bool = True,
        regions: bool = True,
        threads: int | None = 1,
    ) -> None:
        self.mesh, self.camera, self.max_steps = meshes_of([mesh])[0], camera_of(camera), max_steps
        self.search, self.regions = search, regions
        self.threads = checked_threads(threads)
        self.policy: Policy = load_policy() if policy is None else policy
        self.renderer = make_renderer() if renderer is None else renderer

    @with_own_threads
    def refine(self, image: Any, pose: Pose) -> TrackingResult:
        """The pose in an RGB image (H, W, 3) near `pose`; both in the mesh file's frame.

        Raises `InputError` if the image does not fit the camera or the pose is out of sight.
        """
        target = Target(prepare_frame(image, self.camera), self.camera, self.mesh, pose_of(pose))
        return refine_single(
            [target], policy=self.policy, renderer=self.renderer, max_steps=self.max_steps,
            search=self.search, regions=self.regions,
        )[0]  # fmt: skip


def refine_single(
    targets: Sequence[Target], *, policy: Policy, renderer: Renderer,
    max_steps: int | None = None, search: bool = True, regions: bool = True,
) -> list[TrackingResult]:  # fmt: skip
    """`PoseEstimator.refine` for many targets at once, of any objects and images.

    Where the loop ends, a policy of all axes has one more close look, at the picture laid in all
    ways (`TurnedPolicy`): a video has other frames to average over, a single image has not.
    """
    refine = refine_or_search if search else refine_batch
    results = refine(targets, policy=policy, renderer=renderer, max_steps=max_steps)
    if policy.mode is MoveMode.ALL_AXES:
        results = _look_again(targets, results, policy, renderer)
    if not regions:
        return results
    return [
        last_word(target, result, renderer)[0]
        for target, result in zip(targets, results, strict=True)
    ]


def _look_again(
    targets: Sequence[Target], results: Sequence[TrackingResult], policy: Policy, renderer: Renderer
) -> list[TrackingResult]:
    """The results after one more close look each; one that fails then stays as it was."""
    found = list(results)
    ends = [
        (i, replace(target, pose=result.pose, close=True))
        for i, (target, result) in enumerate(zip(targets, results, strict=True))
        if result.pose is not None
    ]
    again = refine_batch(
        [end for _, end in ends], policy=TurnedPolicy(policy), renderer=renderer, max_steps=1
    )
    for (i, _), look in zip(ends, again, strict=True):
        if look.pose is not None:
            found[i] = replace(
                found[i], pose=look.pose, confidence=look.confidence, steps=found[i].steps + 1,
                milliseconds=found[i].milliseconds + look.milliseconds,
            )  # fmt: skip
    return found
