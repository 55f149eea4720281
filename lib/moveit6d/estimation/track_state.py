"""Where an object may be: the poses from which a tracker starts the next frame, places around them.

Never sees an image. A constant-velocity start beside the last pose, and the way back to
where the object was last seen well.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import torch
from torch import Tensor

from ..actions import PoseAction, pose_delta
from ..contour import ColourHistograms
from ..geometry.equivalent import nearest_equivalent
from ..geometry.mesh import Mesh
from ..geometry.pose import Pose
from ..geometry.rotation import exp_so3, log_so3

# Confidence under which a pose is not believed.
LOW_CONFIDENCE = 0.5
# Confidence from which a motion is continued, a pose is gone back to, and a single image's is kept.
# Between the two an object is half covered or smeared, and what seems to be its motion runs away
# with the track.
HIGH_CONFIDENCE = 0.65
# Counts on every axis that an object, surely seen, may have moved by for the next frame to look
# closely at once (`refine.FINE_SCALE`).
SLOW_MOTION = 6.0
# Two starts within so many units on every axis lead to the same place: one of them is enough.
DUPLICATE = 3.0
# Part of the colours that each frame replaces (SRT3D's learning rates).
HISTOGRAM_RATE = 0.2
# Part of the motion that each sure frame replaces, and part of it that an unseen object is taken to
# keep from frame to frame.
VELOCITY_RATE = 0.5
VELOCITY_DECAY = 0.93


@dataclass(frozen=True)
class PerturbationConfig:
    """Places at random around a pose: how many, how far away, and whether to look closely at once.

    `shift` are the most counts aside, up or down, nearer or farther; `turn` the degrees from, to.
    """

    count: int
    shift: tuple[float, float, float]
    turn: tuple[float, float]
    fine: bool = False


@dataclass
class TrackState:
    """What a tracker remembers of one object; poses are the mesh file's, float64.

    `pose` is the last one found, `velocity` (2, 3) its last turn (radians) and shift (metres) from
    frame to frame about the object's centre, `last_confident_pose` the last one that was sure,
    `mean_velocity` (2, 3) the mean velocity up to it and `frames_unconfident` the number of frames
    since; `slow` says that it is the last one and hardly moved; `histograms` are the object's and
    its surroundings' in the frames that were believed, `depth_bias` what the policy is known to be
    off by when it looks closely (`calibration`).
    """

    mesh: Mesh
    pose: Pose
    last_confident_pose: Pose
    velocity: Tensor | None = None
    mean_velocity: Tensor | None = None
    frames_unconfident: int = 0
    above_low: bool = True
    above_high: bool = True
    slow: bool = False
    histograms: ColourHistograms | None = None
    depth_bias: float = 0.0
    random: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))

    @staticmethod
    def begin(mesh: Mesh, pose: Pose) -> TrackState:
        """A track that starts at a pose which is taken to be right."""
        return TrackState(mesh, pose, pose)

    def starts(self) -> list[Pose]:
        """Poses to start the next frame from, each far from the others; the last pose first."""
        found = [self.pose]
        others = [] if self.velocity is None else [self._ahead(self.pose, self.velocity)]
        if not self.above_low:
            others.append(self.last_confident_pose)
        for pose in others:
            if all(_apart(self.mesh, pose, other) for other in found):
                found.append(pose)
        return found

    def recovery_poses(self) -> tuple[Pose, Pose, Pose]:
        """Where an object in doubt may be: where it was last, where it was sure, and ahead of that.

        On its way from there it is taken to slow down, so that the way has an end.
        """
        ahead = self.last_confident_pose
        if self.mean_velocity is not None:
            frames = (1 - VELOCITY_DECAY ** (self.frames_unconfident + 1)) / (1 - VELOCITY_DECAY)
            ahead = self._ahead(self.last_confident_pose, frames * self.mean_velocity)
        return self.pose, self.last_confident_pose, ahead

    def add(self, pose: Pose, confidence: float) -> None:
        """Go on from the pose of the frame that came.

        Of a symmetric object's poses it is the one turned least from the last: no can spins.
        """
        pose = nearest_equivalent(pose, self.pose, self.mesh.symmetries)
        before, after = self.mesh.inner(self.pose), self.mesh.inner(pose)
        was_above_high = self.above_high
        self.above_low, self.above_high = (
            confidence >= LOW_CONFIDENCE,
            confidence >= HIGH_CONFIDENCE,
        )
        self.slow = self.above_high and not _apart(self.mesh, self.pose, pose, SLOW_MOTION)
        self.velocity = None
        if was_above_high and self.above_high:
            turn = log_so3(after.rotation @ before.rotation.mT)
            self.velocity = torch.stack([turn, after.translation - before.translation])
        self.pose = pose
        self.frames_unconfident += 1
        if self.above_high:
            self.last_confident_pose, self.frames_unconfident = pose, 0
            self._update_mean_velocity()

    def update_histograms(self, histograms: ColourHistograms | None) -> None:
        """Remember the colours of a frame, if there are any and its pose was believed."""
        if histograms is not None and self.above_low:
            known = self.histograms
            self.histograms = (
                histograms if known is None else known.blend(histograms, HISTOGRAM_RATE)
            )

    def miss(self) -> None:
        """A frame without a pose: stay where the object was."""
        self.above_low, self.above_high, self.slow, self.velocity = False, False, False, None
        self.frames_unconfident += 1

    def _update_mean_velocity(self) -> None:
        """The mean of the last velocities; none after a gap, in which it may have changed."""
        known, self.mean_velocity = self.mean_velocity, self.velocity
        if known is not None and self.velocity is not None:
            self.mean_velocity = torch.lerp(known, self.velocity, VELOCITY_RATE)

    def _ahead(self, pose: Pose, mean_velocity: Tensor) -> Pose:
        """A pose after a motion (2, 3), a turn and a shift."""
        here = self.mesh.inner(pose)
        ahead = Pose(exp_so3(mean_velocity[0]) @ here.rotation, here.translation + mean_velocity[1])
        return self.mesh.outer(ahead)


def _apart(mesh: Mesh, one: Pose, other: Pose, delta: float = DUPLICATE) -> bool:
    """Whether two poses differ by more than so many units on some axis."""
    a, b = mesh.inner(one), mesh.inner(other)
    if float(a.translation[2]) <= 0 or float(b.translation[2]) <= 0:
        return True
    diameter = torch.tensor(mesh.sphere_diameter, dtype=torch.float64)
    return bool(pose_delta(a, b, diameter).abs().max() > delta)


def sample_perturbation(
    mesh: Mesh, pose: Pose, random: np.random.Generator, config: PerturbationConfig
) -> Pose:
    """A pose at random around another one; both in the mesh file's frame."""
    axis = random.normal(size=3)
    axis *= random.uniform(*config.turn) / np.linalg.norm(axis)
    delta = torch.from_numpy(np.concatenate([random.uniform(-1, 1, 3) * config.shift, axis]))
    diameter = torch.tensor(mesh.sphere_diameter, dtype=torch.float64)
    centred = mesh.inner(pose.to(torch.float64))
    return mesh.outer(PoseAction.from_delta(delta).apply_centred(centred, diameter))
