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
from ..policies import ActionMode, DescriptorPolicy, Policy, load_policy
from ..rendering.renderer import Renderer, make_renderer
from .calibration import depth_bias
from .contour_stage import refine_result
from .detection import PoseDetector, TemplateStore
from .frame import Frame, prepare_frame
from .multi_start import most_confident, perturbed_targets, supports_multi_start
from .recovery import RecoveryConfig, Supervisor
from .refine import StopReason, Target, TrackingResult, check_start, out_of_sight, refine_batch
from .states import TrackingState
from .track_state import LOW_CONFIDENCE, PerturbationConfig, TrackState

# Starts around each of the three recovery poses (`TrackState.recovery_poses`) while the confidence
# is low. Wider perturbations find the object no more often, and more often something else.
RECOVERY = PerturbationConfig(3, shift=(25.0, 25.0, 8.0), turn=(10.0, 30.0))
# Of the contour where it is not measured: what the confidence alone says then.
USUAL_AGREEMENT = 0.4


class PoseTracker:
    """Follows one or several objects through the frames of one camera.

    Args:
        meshes: the object, or the objects, each with its pose in `start`.
        camera: the camera, lens distortion included if it has any.
        start: pose of each object in (or just before) the first frame, mesh file's frame; None for
            one that is to be looked for.
        policy: who decides; the shipped network if None.
        renderer: the back end; embree if None.
        max_iterations: limit per frame; `MAX_ITERATIONS` of the policy's mode if None.
        multi_start: start from recovery poses too while the confidence is low.
        contour: region-based refinement of the pose after the policy's iterations.
        recovery: when an object counts as lost, and how it is looked for. A policy without
            descriptors cannot look for objects: its poses are given as they are, lost or not.
        store: where meshes prepared for the search are kept; in memory if None.
    """

    def __init__(
        self,
        meshes: Mesh | Sequence[Mesh],
        camera: Camera,
        start: Pose | Sequence[Pose | None] | None = None,
        *,
        policy: Policy | None = None,
        renderer: Renderer | None = None,
        max_iterations: int | None = None,
        multi_start: bool = True,
        contour: bool = True,
        recovery: RecoveryConfig | None = None,
        store: TemplateStore | None = None,
    ) -> None:
        self.meshes = [meshes] if isinstance(meshes, Mesh) else list(meshes)
        self.camera, self.max_iterations = camera, max_iterations
        self.multi_start, self.contour = multi_start, contour
        self.policy: Policy = load_policy() if policy is None else policy
        self.renderer = make_renderer() if renderer is None else renderer
        self.recovery = recovery or RecoveryConfig()
        self.store = store or TemplateStore()
        self.tracks: list[TrackState] = []
        self.supervisors: list[Supervisor] = []
        self.reset(start)

    @property
    def poses(self) -> list[Pose]:
        """Where each object was found last, mesh file's frame."""
        return [track.pose for track in self.tracks]

    def reset(self, poses: Pose | Sequence[Pose | None] | None) -> None:
        """Go on from these poses, one an object, mesh file's frame; what was found is forgotten.

        None for objects that are to be looked for. `InputError`, and nothing changed, if a pose is
        missing or cannot be seen by the camera.
        """
        if poses is None:
            given: list[Pose | None] = [None] * len(self.meshes)
        else:
            given = [poses] if isinstance(poses, Pose) else list(poses)
        if len(self.meshes) != len(given):
            raise InputError(f"{len(self.meshes)} meshes but {len(given)} start poses.")
        for mesh, pose in zip(self.meshes, given, strict=True):
            if pose is not None:
                check_start(pose, mesh, self.camera)
        supervisors = [
            Supervisor(self._detector(mesh), self.recovery, pose is not None)
            for mesh, pose in zip(self.meshes, given, strict=True)
        ]
        for supervisor, pose in zip(supervisors, given, strict=True):
            if pose is None and supervisor.detector is None:
                raise InputError(
                    "There is no start pose, and this policy or configuration cannot look for the "
                    "object; give a start pose."
                )
        self.tracks = [
            TrackState.begin(mesh, Pose.identity() if pose is None else pose.to(torch.float64))
            for mesh, pose in zip(self.meshes, given, strict=True)
        ]
        self.supervisors = supervisors

    def _detector(self, mesh: Mesh) -> PoseDetector | None:
        if not self.recovery.enabled or not isinstance(self.policy, DescriptorPolicy):
            return None
        if self.policy.mode is ActionMode.SINGLE:
            return None
        detector = PoseDetector(
            mesh, self.camera, policy=self.policy, renderer=self.renderer, store=self.store
        )
        if self.recovery.max_milliseconds is not None:
            detector.prepare()  # a second or two, which no frame has then
        return detector

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
        result that says why; the next frame starts from the last pose found. A lost object has no
        pose; it is looked for, and followed again from where it is found.
        """
        begin = time.perf_counter()
        try:
            frame = prepare_frame(image, self.camera)
        except InputError as error:
            return tuple(
                one.missed((time.perf_counter() - begin) * 1e3, str(error))
                for one in self.supervisors
            )
        spent = [self._look_for(frame, number) for number in range(len(self.tracks))]
        followed = [number for number, one in enumerate(spent) if one is None]
        try:
            results = dict(zip(followed, self._refine(frame, followed), strict=True))
        except InputError as error:
            milliseconds = (time.perf_counter() - begin) * 1e3
            failed = TrackingResult(None, 0, StopReason.FAILED, 0.0, milliseconds, str(error))
            results = dict.fromkeys(followed, failed)
        return tuple(
            self._add(frame, number, results[number])
            if number in results
            else self.supervisors[number].missed(milliseconds or 0.0)
            for number, milliseconds in enumerate(spent)
        )

    def _look_for(self, frame: Frame, number: int) -> float | None:
        """Look for an object if it is lost; the milliseconds of a search that found nothing yet.

        None for an object that is to be followed, from where it was just found perhaps.
        """
        supervisor, track = self.supervisors[number], self.tracks[number]
        if not supervisor.lost:
            return None
        begin = time.perf_counter()
        found = supervisor.search(frame, track.last_confident_pose)
        if found is None:
            return (time.perf_counter() - begin) * 1e3
        again = TrackState.begin(track.mesh, found)
        again.histograms, again.depth_bias = track.histograms, track.depth_bias
        self.tracks[number] = again
        return None

    def _add(self, frame: Frame, number: int, result: TrackingResult) -> TrackingResult:
        """Go on from a result, after region-based refinement if that is wanted."""
        track, supervisor = self.tracks[number], self.supervisors[number]
        histograms = None
        if self.contour and result.pose is not None:
            target = Target(frame, self.camera, track.mesh, result.pose)
            result, histograms = refine_result(target, result, self.renderer, track.histograms)
        agreement = result.contour_agreement
        judged = supervisor.judged(result, USUAL_AGREEMENT if agreement is None else agreement)
        if result.pose is None:
            track.miss()
            return judged
        track.add(result.pose, result.confidence)
        if judged.state is TrackingState.TRACKING:
            track.update_histograms(histograms)
        return judged if judged.pose is None else replace(judged, pose=track.pose)

    def _refine(self, frame: Frame, numbers: Sequence[int]) -> list[TrackingResult]:
        """Follow objects, each from the best of its starts."""
        targets, groups = [], []
        for number in numbers:
            track = self.tracks[number]
            for pose in track.starts():
                centre = track.mesh.inner(pose).translation
                first = number not in groups
                if first or out_of_sight(centre, track.mesh.sphere_diameter, frame.camera) is None:
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
        return self._recover(frame, numbers, results) if self.multi_start else results

    def _recover(
        self, frame: Frame, numbers: Sequence[int], results: list[TrackingResult]
    ) -> list[TrackingResult]:
        """The results; one of low confidence is replaced by the best result from recovery poses.

        Only by one of higher confidence: a covered object has a low confidence where it is.
        """
        if not supports_multi_start(self.policy):
            return results
        others = [
            self._recovery_targets(frame, self.tracks[number])
            if result.confidence < LOW_CONFIDENCE
            else []
            for number, result in zip(numbers, results, strict=True)
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
