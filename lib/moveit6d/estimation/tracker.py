"""A video: every frame starts where the one before ended.

Never reads files. One bad frame never ends a track. Paper, "Stopping Criteria & Tracking Mode".
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import torch

from ..errors import InputError
from ..geometry.camera import Camera
from ..geometry.mesh import Mesh
from ..geometry.pose import Pose
from ..policies import Policy, load_policy
from ..regions import colours_at
from ..rendering.renderer import Renderer, make_renderer
from ..threads import checked_threads, with_own_threads
from .calibration import depth_bias
from .frame import Frame, prepare_frame
from .hypotheses import DOUBTFUL, Around, Track
from .inputs import camera_of, meshes_of, poses_of
from .last_word import last_word
from .loop import StopReason, Target, TrackingResult, check_start, out_of_sight, refine_batch
from .search import places, searches, surest

# Places looked at around each of the three where an object is likely to be (`Track.likely`) while
# it is not believed to have been found. Farther ones find it no more often, and more often
# something else.
LOST = Around(3, shift=(25.0, 25.0, 8.0), turn=(10.0, 30.0))


class PoseTracker:
    """Follows one or several objects through the frames of one camera.

    Args:
        meshes: the object, or the objects, each with its pose in `start`.
        camera: the camera, lens distortion included if it has any.
        start: pose of each object in (or just before) the first frame, mesh file's frame.
        policy: who decides; the shipped network if None.
        renderer: the back end; embree if None.
        max_steps: limit of cycles a frame; `MAX_STEPS` of the policy's mode if None.
        search: look around for an object whose pose is in doubt.
        regions: after the policy's moves, fit the outline to where the object's colours end.
        threads: CPU threads of torch and OpenCV while it computes; the caller's if None. More than
            one gain little and lose much beside other busy processes.
    """

    def __init__(
        self,
        meshes: Mesh | Sequence[Mesh],
        camera: Camera,
        start: Pose | Sequence[Pose],
        *,
        policy: Policy | None = None,
        renderer: Renderer | None = None,
        max_steps: int | None = None,
        search: bool = True,
        regions: bool = True,
        threads: int | None = 1,
    ) -> None:
        self.meshes = meshes_of(meshes)
        self.camera, self.max_steps = camera_of(camera), max_steps
        self.search, self.regions = search, regions
        self.threads = checked_threads(threads)
        self.tracks: list[Track] = []
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
            Track.begin(mesh, pose.to(torch.float64))
            for mesh, pose in zip(self.meshes, given, strict=True)
        ]

    @with_own_threads
    def learn(self, image: Any) -> None:
        """Learn what the objects look like from an image in which their present poses are exact.

        For the frame of the start poses, if they are known well: the colours tell each object from
        its surroundings (`regions`), and how far off the policy is here it will be off later
        (`calibration`). `InputError` if the image does not fit the camera.
        """
        frame = prepare_frame(image, self.camera)
        for track in self.tracks:
            centred = track.mesh.inner(track.pose)
            track.colours = colours_at(
                frame.pixels, frame.camera.matrix(), track.mesh, centred, self.renderer,
                frame.camera.lens,
            )
            track.depth_bias = depth_bias(frame, track.mesh, track.pose, self.policy, self.renderer)

    @with_own_threads
    def update(self, image: Any) -> tuple[TrackingResult, ...]:
        """Results for the next frame, RGB (H, W, 3), one an object.

        A frame that cannot be used, or an object that cannot be followed in it, gives a failed
        result that says why; the next frame starts from the last pose found.
        """
        begin = time.perf_counter()
        try:
            frame = prepare_frame(image, self.camera)
            prepared = (time.perf_counter() - begin) * 1e3
            results = [
                replace(result, milliseconds=result.milliseconds + prepared)
                for result in self._refine(frame)
            ]
        except InputError as error:
            return (_failed(error, begin),) * len(self.meshes)
        return tuple(
            self._add(frame, track, result)
            for track, result in zip(self.tracks, results, strict=True)
        )

    def _add(self, frame: Frame, track: Track, result: TrackingResult) -> TrackingResult:
        """Go on from a result; its pose is polished first if that is wanted."""
        colours = None
        if self.regions and result.pose is not None:
            target = Target(frame, self.camera, track.mesh, result.pose)
            result, colours = last_word(target, result, self.renderer, track.colours)
        if result.pose is None:
            track.miss()
            return result
        track.add(result.pose, result.confidence)
        track.learn(colours)
        return replace(result, pose=track.pose)

    def _refine(self, frame: Frame) -> list[TrackingResult]:
        """Follow every object from the best of its starts."""
        targets, groups = [], []
        for number, track in enumerate(self.tracks):
            for pose in track.starts():
                centre = track.mesh.inner(pose).translation
                first = number not in groups
                if first or out_of_sight(centre, track.mesh.sphere_diameter, frame.camera) is None:
                    bias, close = track.depth_bias, track.steady
                    targets.append(Target(frame, self.camera, track.mesh, pose, bias, close))
                    groups.append(number)
        results = refine_batch(
            targets,
            policy=self.policy,
            renderer=self.renderer,
            max_steps=self.max_steps,
            groups=groups,
        )
        return self._look_around(frame, results) if self.search else results

    def _look_around(self, frame: Frame, results: list[TrackingResult]) -> list[TrackingResult]:
        """The results; instead of a doubtful one the surest end around where the object may be.

        An end in doubt is no reason to leave the track: a covered object is in doubt where it is.
        """
        if not searches(self.policy):
            return results
        others = [
            self._elsewhere(frame, track) if result.confidence < DOUBTFUL else []
            for track, result in zip(self.tracks, results, strict=True)
        ]
        found = surest(
            results, others, policy=self.policy, renderer=self.renderer, max_steps=self.max_steps
        )
        return [
            new if new.confidence >= DOUBTFUL else replace(old, milliseconds=new.milliseconds)
            for old, new in zip(results, found, strict=True)
        ]

    def _elsewhere(self, frame: Frame, track: Track) -> list[Target]:
        """Where else to start for an object in doubt."""
        found: list[Target] = []
        for pose in track.likely():
            likely = Target(frame, self.camera, track.mesh, pose, track.depth_bias)
            found += places(likely, LOST, track.random)
        return found


def _failed(error: InputError, begin: float) -> TrackingResult:
    milliseconds = (time.perf_counter() - begin) * 1e3
    return TrackingResult(None, 0, StopReason.FAILED, 0.0, milliseconds, str(error))
