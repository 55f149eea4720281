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
from ..policies import ActionMode, DihedralAugmentation, Policy, load_policy
from ..rendering.renderer import Renderer, make_renderer
from .contour_stage import refine_result
from .frame import prepare_frame
from .multi_start import refine_multi_start
from .refine import Target, TrackingResult, refine_batch


class PoseEstimator:
    """Refines poses of one object seen by one camera.

    Args:
        mesh: the object.
        camera: the camera, lens distortion included if it has any.
        policy: who decides; the shipped network if None.
        renderer: the back end; embree if None.
        max_iterations: `MAX_ITERATIONS` of the policy's mode if None.
        multi_start: while the confidence is low, refine from perturbed starts as well.
        contour: region-based refinement of the pose after the policy's iterations.
    """

    def __init__(
        self,
        mesh: Mesh,
        camera: Camera,
        *,
        policy: Policy | None = None,
        renderer: Renderer | None = None,
        max_iterations: int | None = None,
        multi_start: bool = True,
        contour: bool = True,
    ) -> None:
        self.mesh, self.camera, self.max_iterations = mesh, camera, max_iterations
        self.multi_start, self.contour = multi_start, contour
        self.policy: Policy = load_policy() if policy is None else policy
        self.renderer = make_renderer() if renderer is None else renderer

    def refine(self, image: Any, pose: Pose) -> TrackingResult:
        """The pose in an RGB image (H, W, 3) near `pose`; both in the mesh file's frame.

        Raises `InputError` if the image does not fit the camera or the pose is out of sight.
        """
        target = Target(prepare_frame(image, self.camera), self.camera, self.mesh, pose)
        return refine_single(
            [target],
            policy=self.policy,
            renderer=self.renderer,
            max_iterations=self.max_iterations,
            multi_start=self.multi_start,
            contour=self.contour,
        )[0]


def refine_single(
    targets: Sequence[Target],
    *,
    policy: Policy,
    renderer: Renderer,
    max_iterations: int | None = None,
    multi_start: bool = True,
    contour: bool = True,
) -> list[TrackingResult]:
    """`PoseEstimator.refine` for many targets at once, of any objects and images.

    Where the loop ends, a policy of all axes has one more close look, at the picture laid in all
    ways (`DihedralAugmentation`): a video has other frames to average over, a single image has not.
    """
    refine = refine_multi_start if multi_start else refine_batch
    results = refine(targets, policy=policy, renderer=renderer, max_iterations=max_iterations)
    if policy.mode is ActionMode.ALL_AXES:
        results = _look_again(targets, results, policy, renderer)
    if not contour:
        return results
    return [
        refine_result(target, result, renderer)[0]
        for target, result in zip(targets, results, strict=True)
    ]


def _look_again(
    targets: Sequence[Target], results: Sequence[TrackingResult], policy: Policy, renderer: Renderer
) -> list[TrackingResult]:
    """The results after one more close look each; one that fails then stays as it was."""
    found = list(results)
    ends = [
        (i, replace(target, pose=result.pose, fine=True))
        for i, (target, result) in enumerate(zip(targets, results, strict=True))
        if result.pose is not None
    ]
    again = refine_batch(
        [end for _, end in ends],
        policy=DihedralAugmentation(policy),
        renderer=renderer,
        max_iterations=1,
    )
    for (i, _), look in zip(ends, again, strict=True):
        if look.pose is not None:
            found[i] = replace(
                found[i],
                pose=look.pose,
                confidence=look.confidence,
                iterations=found[i].iterations + 1,
                milliseconds=found[i].milliseconds + look.milliseconds,
            )
    return found
