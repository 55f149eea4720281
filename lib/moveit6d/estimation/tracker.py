"""A video: every frame starts where the one before ended.

Never reads files. One bad frame never ends a track. Paper, "Stopping Criteria & Tracking Mode".
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Generic, TypeVar, overload

import numpy as np
import torch

from ..config import TrackerConfig
from ..contour import histograms_at
from ..errors import InputError
from ..frame import Frame, prepare_frame
from ..geometry.camera import Camera
from ..geometry.mesh import Mesh
from ..geometry.pose import Pose
from ..policies import Policy
from ..rendering.renderer import Renderer
from ..threads import checked_threads, with_own_threads
from ..typing import ImageLike
from .apart import Instances
from .calibration import depth_bias, seen_size
from .contour_stage import refine_result
from .detection import PoseDetector, TemplateStore, can_search
from .detection.instances import same_meshes
from .half_turns import is_turned_over, likelier_half_turn
from .inputs import camera_of, config_of, meshes_of, policy_of, renderer_of, start_poses_of
from .keyframes import Keyframe, KeyframeMemory
from .multi_start import start_at
from .recovery import Supervisor
from .recovery_starts import recovered
from .refine import refine_starts
from .results import Refined, Start, TrackingResult, timed
from .states import TrackingState
from .track_state import TrackState
from .turns import SearchTurns
from .visibility import check_start

DEFAULT = TrackerConfig()
Starts = Pose | Sequence[Pose | None] | None
Found = bool | Sequence[bool]
Results = TypeVar("Results", TrackingResult, list[TrackingResult])


class PoseTracker(Generic[Results]):
    """Follows one or several objects through the frames of one camera.

    Args:
        meshes: the object, or a list of objects.
        camera: the camera, lens distortion included if it has any.
        start: pose in (or just before) the first frame, mesh file's frame; of a list of objects a
            list of poses. None for an object that is to be looked for.
        found: whether the start poses come from a search (`reset`).
        policy: predicts the pose deltas; the shipped network if None.
        renderer: the back end; embree if None.
        config: every other setting.
        store: where meshes prepared for the search are kept; in memory if None.
        threads: CPU threads of torch and OpenCV while it computes; the caller's if None. More than
            one gain little and lose much beside other busy processes.

    With one mesh `update` returns one result, with a list of meshes a list of results. A lost
    object has no pose (`TrackingResult.state`); it is looked for, and followed again from where it
    is found. A policy without descriptors, or of single actions, cannot look for objects: its poses
    are given as they are, lost or not.

    Example:
        >>> import numpy as np
        >>> from moveit6d import Camera, Mesh, OraclePolicy, Pose, PoseTracker
        >>> corners = [[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]]
        >>> mesh = Mesh.from_arrays("corner", corners, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
        >>> camera = Camera(300, 300, 159.5, 119.5, 320, 240)
        >>> image = np.zeros((240, 320, 3), np.uint8)
        >>> truth = Pose.from_rvec([0, 0, 0], [0.01, 0, 0.5])
        >>> start = Pose.from_rvec([0, 0, 0], [0, 0, 0.5])
        >>> policy = OraclePolicy(Pose.stack([mesh.inner(truth)]))  # knows the answer
        >>> tracker = PoseTracker(mesh, camera, start, policy=policy)
        >>> for _ in range(3):
        ...     result = tracker.update(image)
        >>> bool((result.pose.translation - truth.translation).norm() < 0.002)
        True
    """

    @overload
    def __init__(
        self: PoseTracker[TrackingResult],
        meshes: Mesh,
        camera: Camera,
        start: Pose | None = None,
        *,
        policy: Policy | None = None,
        renderer: Renderer | None = None,
        config: TrackerConfig = DEFAULT,
        store: TemplateStore | None = None,
        threads: int | None = 1,
        found: Found = False,
    ) -> None: ...

    @overload
    def __init__(
        self: PoseTracker[list[TrackingResult]],
        meshes: Sequence[Mesh],
        camera: Camera,
        start: Sequence[Pose | None] | None = None,
        *,
        policy: Policy | None = None,
        renderer: Renderer | None = None,
        config: TrackerConfig = DEFAULT,
        store: TemplateStore | None = None,
        threads: int | None = 1,
        found: Found = False,
    ) -> None: ...

    def __init__(
        self,
        meshes: Mesh | Sequence[Mesh],
        camera: Camera,
        start: Starts = None,
        *,
        policy: Policy | None = None,
        renderer: Renderer | None = None,
        config: TrackerConfig = DEFAULT,
        store: TemplateStore | None = None,
        threads: int | None = 1,
        found: Found = False,
    ) -> None:
        self.single = isinstance(meshes, Mesh)
        self.meshes = meshes_of(meshes)
        self.camera, self.config = camera_of(camera), config_of(config)
        self.threads = checked_threads(threads)
        self.policy: Policy = policy_of(policy)
        self.renderer = renderer_of(renderer)
        self.store = store or TemplateStore()
        self._same = same_meshes(self.meshes)
        self._turns = SearchTurns(self.config.recovery, self._same)
        self.tracks: list[TrackState] = []
        self.supervisors: list[Supervisor] = []
        self.reset(start, found)

    @property
    def poses(self) -> list[Pose]:
        """Where each object was found last, mesh file's frame; of no use for one never found."""
        return [track.pose for track in self.tracks]

    @with_own_threads
    def reset(self, poses: Starts, found: Found = False) -> None:
        """Go on from these poses, one an object, mesh file's frame; what was found is forgotten.

        None for objects that are to be looked for. `found` says, for all or for each, that poses
        come from a search: they are compared with their half turns then, and looked at again, as
        those are that the tracker finds. `InputError`, and nothing changed, if a pose is missing or
        cannot be seen by the camera, or if `recovery.distance` is too far for an object.
        """
        given = start_poses_of(poses, len(self.meshes))
        searched = [found] * len(given) if isinstance(found, bool) else list(found)
        if len(searched) != len(given):
            raise InputError(f"found: {len(given)} are needed, or one, found {len(searched)}.")
        supervisors = [
            self._supervisor(number, mesh, pose, one)
            for number, (mesh, pose, one) in enumerate(
                zip(self.meshes, given, searched, strict=True)
            )
        ]
        self.tracks = [
            TrackState.begin(
                mesh,
                Pose.identity() if pose is None else mesh.inner(pose.to(torch.float64)),
                self.config,
            )
            for mesh, pose in zip(self.meshes, given, strict=True)
        ]
        self.supervisors = supervisors

    @with_own_threads
    def replace_mesh(self, number: int, mesh: Mesh, pose: Pose) -> None:
        """Follow the object with this number by another mesh of its shape, as one that was painted.

        `pose` is where it is, mesh file's frame. Its way stays, and of which objects it is an
        instance; its state, which knows colours, and what looks for it begin anew. `InputError`,
        and nothing changed, if the shape is another one or the camera cannot see it there.
        """
        (mesh,), (start,), known = meshes_of(mesh), start_poses_of(pose, 1), self.meshes[number]
        larger = abs(mesh.sphere_diameter - known.sphere_diameter)
        if max(larger, *np.abs(mesh.center - known.center)) > 1e-4 * known.sphere_diameter:
            raise InputError(
                f"{mesh.name} has another size or middle than {known.name}; make a new PoseTracker "
                "for another object."
            )
        found = self.supervisors[number].check is not None
        self.supervisors[number] = self._supervisor(number, mesh, start, found)
        self.meshes[number] = mesh
        # Keyframes are kept of meshes without colours only.
        track = self.tracks[number]
        self.tracks[number] = replace(
            track, mesh=mesh.scaled(track.size), keyframes=None, sure_keyframes=None
        )

    def _supervisor(self, number: int, mesh: Mesh, pose: Pose | None, found: bool) -> Supervisor:
        """What watches an object from now on; `found`: a pose that there is comes from a search."""
        if pose is not None:
            check_start(pose, mesh, self.camera)
        detector = None
        if can_search(self.policy, self.config):
            detector = PoseDetector(
                mesh, self.camera, policy=self.policy, renderer=self.renderer, config=self.config,
                store=self.store, threads=self.threads,
            )  # fmt: skip
        recovery, known = self.config.recovery, pose is not None
        supervisor = Supervisor.begin(detector, recovery, mesh, known, number)
        if known and found:
            supervisor.was_found()
        return supervisor

    @with_own_threads
    def calibrate(self, image: ImageLike | Frame) -> None:
        """Calibrate from an image in which the present poses are exact.

        For the frame of the start poses, if they are known well: the colours tell each object from
        its surroundings (`contour`), it will look as large later as it does here, and how far off
        the policy is here it will be off later (`calibration`). `InputError` if the image does not
        fit the camera, or if a pose is not known.
        """
        frame = prepare_frame(image, self.camera)
        if any(supervisor.lost for supervisor in self.supervisors):
            raise InputError("There is nothing to calibrate from while an object is lost.")
        for number, (mesh, track) in enumerate(zip(self.meshes, self.tracks, strict=True)):
            before = track.keyframes
            exact = self._exact(frame, track, mesh)
            track.size = seen_size(exact, self.policy, self.renderer, self.config, number)
            track.keyframes = before
            exact = self._exact(frame, track, mesh.scaled(track.size))
            track.depth_bias = depth_bias(exact, self.policy, self.renderer, self.config, number)
            track.histograms = histograms_at(
                frame.pixels, frame.intrinsics, track.mesh, track.centred, self.renderer,
                self.config.contour, frame.camera.lens,
            )  # fmt: skip

    def _exact(self, frame: Frame, track: TrackState, mesh: Mesh) -> Start:
        """Follow by this mesh, with what the frame shows of it, from where it is exactly."""
        track.mesh = mesh
        self._remember(frame, track, 1.0)
        track.sure_keyframes = track.keyframes
        return Start(frame, mesh, track.centred, keyframes=track.keyframes)

    @with_own_threads
    def update(self, image: ImageLike | Frame | None) -> Results:
        """The result for the next frame, RGB (H, W, 3); for a list of meshes a list of results.

        A frame that cannot be used (None: it could not be read), or an object that cannot be
        followed in it, gives a failed result that says why; the next frame starts from the last
        pose found. A frame that cannot be used takes 0 milliseconds.
        """
        results = self._update(image)
        return results[0] if self.single else results  # type: ignore[return-value]

    def _update(self, image: ImageLike | Frame | None) -> list[TrackingResult]:
        begin = time.perf_counter()
        try:
            frame = prepare_frame(image, self.camera)
        except InputError as error:
            return [supervisor.unread(str(error)) for supervisor in self.supervisors]
        objects = range(len(self.tracks))
        followed = [number for number in objects if not self.supervisors[number].lost]
        for number, spent in self._turns.of_frame(self.supervisors):
            if self._is_found(frame, number, followed, spent):
                followed.append(number)
        followed.sort()
        refined = dict(zip(followed, self._refine(frame, followed), strict=True))
        return [
            timed(
                self._add(frame, number, refined[number])
                if number in refined
                else self.supervisors[number].missed(),
                begin,
            )
            for number in objects
        ]

    def _is_found(self, frame: Frame, number: int, followed: Sequence[int], spent: float) -> bool:
        """Look for a lost object; whether it is to be followed now, from where it was found."""
        supervisor, track = self.supervisors[number], self.tracks[number]
        last, taken = track.mesh.outer(track.last_confident), self._taken(number, followed)
        found = supervisor.search(frame, last, taken, spent)
        if found is None:
            return False
        self._begin_again(number, track.mesh.inner(found.to(torch.float64)), track.keyframes)
        return True

    def _taken(self, number: int, followed: Sequence[int]) -> list[Pose]:
        """Where other instances of an object's mesh are, of those that are followed."""
        return [self.tracks[other].pose for other in self._same[number] if other in followed]

    def _begin_again(self, number: int, centred: Pose, keyframes: KeyframeMemory | None) -> None:
        """Follow an object from another pose, with these keyframes."""
        self.tracks[number] = self.tracks[number].begin_again(centred, keyframes)
        self.supervisors[number].forget_half_turns()

    def _refine(self, frame: Frame, numbers: Sequence[int]) -> list[Refined]:
        """Follow objects, each from the best of its starts, and recover those of low confidence."""
        instances = Instances(self.tracks, self._same, self.camera, self.config)
        before = {number: self.tracks[number].centred for number in numbers}
        groups, starts = [], []
        for number in numbers:
            track = self.tracks[number]
            for k, centred in enumerate(track.starts()):
                if k and instances.stands_on_another(number, centred, before):
                    continue
                groups.append(number)
                starts.append(
                    Start(frame, track.mesh, centred, track.depth_bias, track.slow, track.keyframes)
                )
        ends = refine_starts(
            starts,
            policy=self.policy,
            renderer=self.renderer,
            loop=self.config.loop,
            groups=groups,
        )
        results = instances.kept_apart(dict(zip(numbers, ends, strict=True)))
        results = instances.kept_apart(self._recover(frame, results, instances), results)
        return [
            self._turned(frame, number, self._looked_at_again(frame, number, numbers, result))
            for number, result in results.items()
        ]

    def _looked_at_again(
        self, frame: Frame, number: int, followed: Sequence[int], result: Refined
    ) -> Refined:
        """The result, or one from a pose that a second look found, if it is much likelier."""
        look, track = self.supervisors[number].look, self.tracks[number]
        if look is None or result.centred is None:
            return result
        start = start_at(frame, track, result.centred)
        better = look.better(start, result.confidence, self._taken(number, followed))
        if better is None or better.centred is None:
            return result
        self._begin_again(number, better.centred, track.sure_keyframes)
        return better

    def _turned(self, frame: Frame, number: int, result: Refined) -> Refined:
        """The result, or for an object that was found lately its half turn, if it is likelier."""
        check, track = self.supervisors[number].check, self.tracks[number]
        if check is None or result.centred is None:
            return result
        if is_turned_over(track.centred, track.nearest_equivalent(result.centred)):
            check.restart()
        better = likelier_half_turn(
            check, start_at(frame, track, result.centred), result.confidence,
            policy=self.policy, renderer=self.renderer, loop=self.config.loop, target=number,
        )  # fmt: skip
        if better is None or better.centred is None:
            return result
        self._begin_again(number, better.centred, track.sure_keyframes)
        return better

    def _recover(
        self, frame: Frame, results: dict[int, Refined], instances: Instances
    ) -> dict[int, Refined]:
        """The results; one of low confidence is replaced by the best one from recovery poses."""
        found = recovered(
            frame, results, instances,
            policy=self.policy, renderer=self.renderer, config=self.config,
        )  # fmt: skip
        for number, new in found.items():
            if new is not results[number]:
                self.supervisors[number].forget_half_turns()
        return found

    def _add(self, frame: Frame, number: int, result: Refined) -> TrackingResult:
        """Refine the contour of a result, say how likely it is, and go on from it."""
        track, supervisor = self.tracks[number], self.supervisors[number]
        result, histograms = refine_result(
            frame, track.mesh, result, self.renderer, self.config.contour, track.histograms
        )
        if result.centred is None:
            track.miss()
        else:
            track.add(result.centred, result.confidence)
            result = replace(result, centred=track.centred)
        agreement = result.contour_agreement
        if agreement is None:
            agreement = self.config.recovery.states.usual_agreement
        assessed = supervisor.assessed(result.result(track.mesh), agreement)
        if assessed.state is TrackingState.TRACKING:
            track.update_histograms(histograms)
            self._remember(frame, track, assessed.confidence)
        return assessed

    def _remember(self, frame: Frame, track: TrackState, confidence: float) -> None:
        """Keep what a frame shows of an object at its pose, if that is new and to be kept."""
        known = track.keyframes
        if known is not None and known.wants(track.centred, confidence):
            track.keyframes = known.add(
                Keyframe.take(frame, track.mesh, track.centred, self.renderer, known.config)
            )
