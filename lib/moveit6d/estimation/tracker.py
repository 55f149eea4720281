"""A video: every frame starts where the one before ended.

Never reads files. One bad frame never ends a track. Paper, "Stopping Criteria & Tracking Mode".
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import torch

from ..contour import histograms_at
from ..errors import InputError
from ..geometry.camera import Camera
from ..geometry.mesh import Mesh
from ..geometry.pose import Pose
from ..geometry.visibility import why_unseen
from ..policies import Policy, load_policy
from ..rendering.renderer import Renderer, make_renderer
from .calibration import depth_bias
from .contour_stage import refine_result
from .frame import Frame, prepare_frame
from .multi_start import most_confident, perturbed_targets, supports_multi_start
from .refine import StopReason, Target, TrackingResult, check_start, refine_batch
from .track_state import LOW_CONFIDENCE, PerturbationConfig, TrackState

# Starts around each of the three recovery poses (`TrackState.recovery_poses`) while the confidence
# is low. Wider perturbations find the object no more often, and more often something else.
RECOVERY = PerturbationConfig(3, shift=(25.0, 25.0, 8.0), turn=(10.0, 30.0))


class PoseTracker:
    """Follows one or several objects through the frames of one camera.

    Args:
        meshes: the object, or the objects, each with its pose in `start`.
        camera: the camera, lens distortion included if it has any.
        start: pose of each object in (or just before) the first frame, mesh file's frame.
        policy: who decides; the shipped network if None.
        renderer: the back end; embree if None.
        max_iterations: limit per frame; `MAX_ITERATIONS` of the policy's mode if None.
        multi_start: start from recovery poses too while the confidence is low.
        contour: region-based refinement of the pose after the policy's iterations.
    """

    def __init__(
        self,
        meshes: Mesh | Sequence[Mesh],
        camera: Camera,
        start: Pose | Sequence[Pose],
        *,
        policy: Policy | None = None,
        renderer: Renderer | None = None,
        max_iterations: int | None = None,
        multi_start: bool = True,
        contour: bool = True,
    ) -> None:
        self.meshes = [meshes] if isinstance(meshes, Mesh) else list(meshes)
        self.camera, self.max_iterations = camera, max_iterations
        self.multi_start, self.contour = multi_start, contour
        self.tracks: list[TrackState] = []
        self.reset(start)
        self.policy: Policy = load_policy() if policy is None else policy
        self.renderer = make_renderer() if renderer is None else renderer

    @property
    def poses(self) -> list[Pose]:
        """Where each object was found last, mesh file's frame."""
        return [track.pose for track in self.tracks]

    def reset(self, poses: Pose | Sequence[Pose]) -> None:
        """Go on from these poses, one an object, mesh file's frame; what was found is forgotten.

        `InputError`, and nothing changed, if a pose is missing or cannot be seen by the camera.
        """
        given = [poses] if isinstance(poses, Pose) else list(poses)
        if len(self.meshes) != len(given):
            raise InputError(f"{len(self.meshes)} meshes but {len(given)} start poses.")
        for mesh, pose in zip(self.meshes, given, strict=True):
            check_start(pose, mesh, self.camera)
        self.tracks = [
            TrackState.begin(mesh, pose.to(torch.float64))
            for mesh, pose in zip(self.meshes, given, strict=True)
        ]

    def calibrate(self, image: Any) -> None:
        """Learn what the objects look like from an image in which their present poses are exact.

        For the frame of the start poses, if they are known well: the colours tell each object from
        its surroundings (`contour`), and how far off the policy is here it will be off later
        (`calibration`). `InputError` if the image does not fit the camera.
        """
        frame = prepare_frame(image, self.camera)
        for track in self.tracks:
            centred = track.mesh.inner(track.pose)
            track.histograms = histograms_at(
                frame.pixels, frame.camera.matrix(), track.mesh, centred, self.renderer
            )
            track.depth_bias = depth_bias(frame, track.mesh, track.pose, self.policy, self.renderer)

    def update(self, image: Any) -> tuple[TrackingResult, ...]:
        """Results for the next frame, RGB (H, W, 3), one an object.

        A frame that cannot be used, or an object that cannot be followed in it, gives a failed
        result that says why; the next frame starts from the last pose found.
        """
        begin = time.perf_counter()
        try:
            frame = prepare_frame(image, self.camera)
            results = self._refine(frame)
        except InputError as error:
            return (_failed(error, begin),) * len(self.meshes)
        return tuple(
            self._add(frame, track, result)
            for track, result in zip(self.tracks, results, strict=True)
        )

    def _add(self, frame: Frame, track: TrackState, result: TrackingResult) -> TrackingResult:
        """Go on from a result, after region-based refinement if that is wanted."""
        histograms = None
        if self.contour and result.pose is not None:
            target = Target(frame, self.camera, track.mesh, result.pose)
            result, histograms = refine_result(target, result, self.renderer, track.histograms)
        if result.pose is None:
            track.miss()
            return result
        track.add(result.pose, result.confidence)
        track.update_histograms(histograms)
        return replace(result, pose=track.pose)

    def _refine(self, frame: Frame) -> list[TrackingResult]:
        """Follow every object from the best of its starts."""
        targets, groups = [], []
        for number, track in enumerate(self.tracks):
            for pose in track.starts():
                first = number not in groups
                centred = track.mesh.inner(pose)
                if first or why_unseen(centred, track.mesh, frame.camera) is None:
                    bias, fine = track.depth_bias, track.slow
                    targets.append(Target(frame, self.camera, track.mesh, pose, bias, fine))
                    groups.append(number)
        results = refine_batch(
            targets,
            policy=self.policy,
            renderer=self.renderer,
            max_iterations=self.max_iterations,
            groups=groups,
        )
        return self._recover(frame, results) if self.multi_start else results

    def _recover(self, frame: Frame, results: list[TrackingResult]) -> list[TrackingResult]:
        """The results; one of low confidence is replaced by the best result from recovery poses.

        Only by one of higher confidence: a covered object has a low confidence where it is.
        """
        if not supports_multi_start(self.policy):
            return results
        others = [
            self._recovery_targets(frame, track) if result.confidence < LOW_CONFIDENCE else []
            for track, result in zip(self.tracks, results, strict=True)
        ]
        found = most_confident(
            results,
            others,
            policy=self.policy,
            renderer=self.renderer,
            max_iterations=self.max_iterations,
        )
        return [
            new if new.confidence >= LOW_CONFIDENCE else replace(old, milliseconds=new.milliseconds)
            for old, new in zip(results, found, strict=True)
        ]

    def _recovery_targets(self, frame: Frame, track: TrackState) -> list[Target]:
        """Starts for an object whose confidence is low."""
        found: list[Target] = []
        for pose in track.recovery_poses():
            recovery_poses = Target(frame, self.camera, track.mesh, pose, track.depth_bias)
            found += perturbed_targets(recovery_poses, RECOVERY, track.random)
        return found


def _failed(error: InputError, begin: float) -> TrackingResult:
    milliseconds = (time.perf_counter() - begin) * 1e3
    return TrackingResult(None, 0, StopReason.FAILED, 0.0, milliseconds, str(error))
