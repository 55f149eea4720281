"""What goes into the refinement of a pose and what comes out.

Never computes a pose. Users' poses (`Target`, `TrackingResult`) are in the mesh file's frame;
inside, poses are centred and called so (`Start`, `Refined`), and are converted here, once.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import torch
from torch import Tensor

from ..frame import Frame, prepare_frame
from ..geometry.camera import Camera
from ..geometry.mesh import Mesh
from ..geometry.pose import Pose
from ..typing import ImageLike
from .covariance import Information, pose_covariance
from .keyframes import KeyframeMemory
from .states import TrackingState


class StopReason(StrEnum):
    """Why a loop ended."""

    STOP_ACTION = "stop_action"
    REVISITED = "revisited"  # a pose of this loop came again: oscillation
    MAX_ITERATIONS = "max_iterations"
    FAILED = "failed"  # no pose; the result's `error` says why


@dataclass(frozen=True, eq=False)
class Target:
    """One object to refine in one image, with its pose in the mesh file's frame.

    `image` is RGB (H, W, 3), or a `Frame` if several targets share it.
    """

    image: ImageLike | Frame
    camera: Camera
    mesh: Mesh
    pose: Pose


@dataclass(frozen=True, eq=False)
class TrackingResult:
    """The outcome of a refinement.

    `pose` is unbatched float64 in the mesh file's frame, None if it failed, and then `error` says
    why. `confidence` in [0, 1] is the policy's probability that the pose is right; in tracks it is
    that of the pose at the end of the loop, before contour refinement moved it, and in single
    images it is by `SingleImageConfig`. `probability` goes by everything that is compared: in
    tracks it is `state_probability`, by which the states go (`StateConfig`), which is None
    elsewhere. `localizability` in [0, 1]
    is the probability that a pose which looks right is right (`localizability`). `milliseconds`
    passed until this object was done. `contour_agreement` is the share of the contour where colours
    change sharply and in the right place, None without contour refinement; `state` is a tracker's.
    `covariance` (6, 6) is that of the pose at the end of the loop: of its translation, metres, and
    of its rotation vector, radians, along and about the camera's axes; None where it is not known.
    It holds for a pose that is right about the object and its side (`confidence`), and does not
    know of errors in mesh and camera.
    """

    pose: Pose | None
    iterations: int
    stopped_by: StopReason
    confidence: float
    milliseconds: float
    error: str | None = None
    localizability: float = 0.0
    contour_agreement: float | None = None
    state: TrackingState = TrackingState.TRACKING
    covariance: Tensor | None = None
    state_probability: float | None = None

    @property
    def probability(self) -> float | None:
        """That ADD(-S) is below a tenth of the diameter, in [0, 1]; None if there is no pose."""
        if self.pose is None:
            return None
        return self.confidence if self.state_probability is None else self.state_probability

    @property
    def score(self) -> float:
        """How likely the pose is within a tenth of the diameter: both probabilities together."""
        return self.confidence * self.localizability


@dataclass(frozen=True, eq=False)
class Start:
    """Where a loop starts: a frame, a mesh and a centred pose, float64.

    `depth_bias` are the units of t_z that the policy is known to be off by in the fine stage
    (`calibration`); with `fine` the loop starts there. `keyframes` are what the object looked like
    in earlier frames.
    """

    frame: Frame
    mesh: Mesh
    centred: Pose
    depth_bias: float = 0.0
    fine: bool = False
    keyframes: KeyframeMemory | None = None


@dataclass(frozen=True, eq=False)
class Refined:
    """The outcome of a loop: as `TrackingResult`, with a centred pose and what is known of it."""

    centred: Pose | None
    iterations: int
    stopped_by: StopReason
    confidence: float
    milliseconds: float
    error: str | None = None
    localizability: float = 0.0
    contour_agreement: float | None = None
    information: Information | None = None

    def result(self, mesh: Mesh) -> TrackingResult:
        """The outcome as users get it, in the mesh file's frame."""
        pose = covariance = None
        if self.centred is not None:
            pose = mesh.outer(self.centred)
            if self.information is not None:
                covariance = pose_covariance(self.information, self.centred, mesh)
        return TrackingResult(
            pose,
            self.iterations,
            self.stopped_by,
            self.confidence,
            self.milliseconds,
            self.error,
            self.localizability,
            self.contour_agreement,
            covariance=covariance,
        )


def starts_of(targets: Sequence[Target]) -> list[Start]:
    """The starts of targets; images that several of them share are prepared once.

    `InputError` if an image does not fit its camera.
    """
    prepared: dict[tuple[int, Camera], Frame] = {}
    starts = []
    for target in targets:
        key = (id(target.image), target.camera)
        if key not in prepared:
            prepared[key] = prepare_frame(target.image, target.camera)
        centred = target.mesh.inner(target.pose.detach().to(torch.float64))
        starts.append(Start(prepared[key], target.mesh, centred))
    return starts


def timed(result: TrackingResult, begin: float) -> TrackingResult:
    """The result with the time since the frame came: what the caller waited for it."""
    return replace(result, milliseconds=(time.perf_counter() - begin) * 1e3)
