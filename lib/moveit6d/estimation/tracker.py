"""A video: every frame starts where the one before ended.

Never reads files. One bad frame never ends a track. Paper, "Stopping Criteria & Tracking Mode".
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Generic, TypeVar, overload

import torch

from ..config import TrackerConfig
from ..contour import histograms_at
from ..errors import InputError
from ..frame import Frame, prepare_frame
from ..geometry.camera import Camera
from ..geometry.mesh import Mesh
from ..geometry.pose import Pose
from ..policies import Policy, load_policy
from ..rendering.backends import make_renderer
from ..rendering.renderer import Renderer
from ..threads import checked_threads, with_own_threads
from ..typing import ImageLike
from .calibration import depth_bias
from .contour_stage import refine_result
from .inputs import camera_of, meshes_of, poses_of
from .multi_start import most_confident, perturbed_starts, uses_multi_start
from .refine import refine_starts
from .results import Refined, Start, StopReason, TrackingResult
from .track_state import TrackState
from .visibility import check_start

DEFAULT = TrackerConfig()
Results = TypeVar("Results", TrackingResult, list[TrackingResult])


class PoseTracker(Generic[Results]):
    """Follows one or several objects through the frames of one camera.

    Args:
        meshes: the object, or a list of objects.
        camera: the camera, lens distortion included if it has any.
        start: pose in (or just before) the first frame, mesh file's frame; of a list of objects a
            list of poses.
        policy: predicts the pose deltas; the shipped network if None.
        renderer: the back end; embree if None.
        config: every other setting.
        threads: CPU threads of torch and OpenCV while it computes; the caller's if None. More than
            one gain little and lose much beside other busy processes.

    With one mesh `update` returns one result, with a list of meshes a list of results.
    """

    @overload
    def __init__(
        self: PoseTracker[TrackingResult],
        meshes: Mesh,
        camera: Camera,
        start: Pose,
        *,
        policy: Policy | None = None,
        renderer: Renderer | None = None,
        config: TrackerConfig = DEFAULT,
        threads: int | None = 1,
    ) -> None: ...

    @overload
    def __init__(
        self: PoseTracker[list[TrackingResult]],
        meshes: Sequence[Mesh],
        camera: Camera,
        start: Sequence[Pose],
        *,
        policy: Policy | None = None,
        renderer: Renderer | None = None,
        config: TrackerConfig = DEFAULT,
        threads: int | None = 1,
    ) -> None: ...

    def __init__(
        self,
        meshes: Mesh | Sequence[Mesh],
        camera: Camera,
        start: Pose | Sequence[Pose],
        *,
        policy: Policy | None = None,
        renderer: Renderer | None = None,
        config: TrackerConfig = DEFAULT,
        threads: int | None = 1,
    ) -> None:
        self.single = isinstance(meshes, Mesh)
        self.meshes = meshes_of(meshes)
        self.camera, self.config, self.threads = camera_of(camera), config, checked_threads(threads)
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
        given = poses_of(poses)
        if len(self.meshes) != len(given):
            raise InputError(
                f"{len(self.meshes)} meshes need as many start poses, found {len(given)}."
            )
        for mesh, pose in zip(self.meshes, given, strict=True):
            check_start(pose, mesh, self.camera)
        self.tracks = [
            TrackState.begin(mesh, mesh.inner(pose.to(torch.float64)), self.config)
            for mesh, pose in zip(self.meshes, given, strict=True)
        ]

    @with_own_threads
    def calibrate(self, image: ImageLike | Frame) -> None:
        """Calibrate from an image in which the present poses are exact.

        For the frame of the start poses, if they are known well: the colours tell each object from
        its surroundings (`contour`), and how far off the policy is here it will be off later
        (`calibration`). `InputError` if the image does not fit the camera.
        """
        frame = prepare_frame(image, self.camera)
        for track in self.tracks:
            exact = Start(frame, track.mesh, track.centred)
            track.histograms = histograms_at(
                frame.pixels,
                frame.intrinsics,
                track.mesh,
                track.centred,
                self.renderer,
                self.config.contour,
                frame.camera.lens,
            )
            track.depth_bias = depth_bias(exact, self.policy, self.renderer, self.config)

    @with_own_threads
    def update(self, image: ImageLike | Frame | None) -> Results:
        """The result for the next frame, RGB (H, W, 3); for a list of meshes a list of results.

        A frame that cannot be used (None: it could not be read), or an object that cannot be
        followed in it, gives a failed result that says why; the next frame starts from the last
        pose found.
        """
        results = self._update(image)
        return results[0] if self.single else results  # type: ignore[return-value]

    def _update(self, image: ImageLike | Frame | None) -> list[TrackingResult]:
        begin = time.perf_counter()
        try:
            frame = prepare_frame(image, self.camera)
        except InputError as error:
            spent = (time.perf_counter() - begin) * 1e3
            failed = TrackingResult(None, 0, StopReason.FAILED, 0.0, spent, str(error))
            return [failed] * len(self.meshes)
        results = self._refine(frame)
        return [
            _timed(self._add(frame, track, result), begin)
            for track, result in zip(self.tracks, results, strict=True)
        ]

    def _refine(self, frame: Frame) -> list[Refined]:
        """Follow every object from the best of its starts, and recover the lost ones."""
        groups = [number for number, track in enumerate(self.tracks) for _ in track.starts()]
        starts = [
            Start(frame, track.mesh, centred, track.depth_bias, track.slow)
            for track in self.tracks
            for centred in track.starts()
        ]
        results = refine_starts(
            starts,
            policy=self.policy,
            renderer=self.renderer,
            loop=self.config.loop,
            groups=groups,
        )
        return self._recover(frame, results)

    def _recover(self, frame: Frame, results: list[Refined]) -> list[Refined]:
        """The results; one of low confidence is replaced by the best one from recovery poses.

        Only by one that is not low: an occluded object has a low confidence where it is.
        """
        if not uses_multi_start(self.policy, self.config):
            return results
        low = self.config.low_confidence
        others = [
            self._recovery_starts(frame, track)
            if result.confidence < low and track.is_recovery_due()
            else []
            for track, result in zip(self.tracks, results, strict=True)
        ]
        found = most_confident(
            results,
            others,
            policy=self.policy,
            renderer=self.renderer,
            config=self.config,
            race=self.config.multi_start.race,
        )
        return [
            new if new.confidence >= low else replace(old, milliseconds=new.milliseconds)
            for old, new in zip(results, found, strict=True)
        ]

    def _recovery_starts(self, frame: Frame, track: TrackState) -> list[Start]:
        """Perturbed starts around the recovery poses."""
        around = self.config.multi_start.recovery
        return [
            start
            for centred in track.recovery_poses()
            for start in perturbed_starts(
                Start(frame, track.mesh, centred, track.depth_bias), around, track.random
            )
        ]

    def _add(self, frame: Frame, track: TrackState, result: Refined) -> TrackingResult:
        """Refine the contour of a result and go on from it."""
        start = Start(frame, track.mesh, track.centred)
        result, histograms = refine_result(
            start, result, self.renderer, self.config.contour, track.histograms
        )
        if result.centred is None:
            track.miss()
        else:
            track.add(result.centred, result.confidence)
            track.update_histograms(histograms)
            result = replace(result, centred=track.centred)
        return result.result(track.mesh)


def _timed(result: TrackingResult, begin: float) -> TrackingResult:
    """The result with the time since the frame came: what the caller waited for it."""
    return replace(result, milliseconds=(time.perf_counter() - begin) * 1e3)
