"""What a tracker remembers of one object, and where it starts the next frame.

Never sees an image. Constant velocity, and the way back to the last confident pose.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import torch
from torch import Tensor

from ..actions import pose_delta
from ..config import TrackerConfig
from ..contour import ColourHistograms
from ..geometry.equivalent import nearest_equivalent
from ..geometry.mesh import Mesh
from ..geometry.pose import Pose
from ..geometry.rotation import exp_so3, log_so3
from .keyframes import KeyframeMemory

DEFAULT = TrackerConfig()


@dataclass
class TrackState:
    """The memory of one object's track; poses are centred, float64 (`pose` converts).

    `centred` is the last pose, `velocity` (2, 3) its last rotation vector (radians) and shift
    (metres) from frame to frame; `last_confident` the last pose of high confidence, `mean_velocity`
    (2, 3) the mean velocity up to it and `frames_unconfident` the number of frames since.
    `frames_low` counts the frames in a row whose confidence was low.
    `above_low` and `above_high` say which thresholds the last confidence reached, `slow` that the
    object is confidently tracked and hardly moved, `begins` that it was just found: what leads from
    there to the next pose, which is of the same frame, is no motion. `histograms` are the colours
    of the object and its surroundings. `size` is how many times as large as the user's mesh `mesh`
    is, `depth_bias` what the policy is known to be off by (`calibration`, both), `keyframes` what
    the object looked like, None where that is not remembered, and `sure_keyframes` those that do
    not rest on the pose that the track began with.
    """

    mesh: Mesh
    centred: Pose
    last_confident: Pose
    config: TrackerConfig = DEFAULT
    velocity: Tensor | None = None
    mean_velocity: Tensor | None = None
    frames_unconfident: int = 0
    frames_low: int = 0
    above_low: bool = True
    above_high: bool = True
    slow: bool = False
    begins: bool = False
    histograms: ColourHistograms | None = None
    size: float = 1.0
    depth_bias: float = 0.0
    keyframes: KeyframeMemory | None = None
    sure_keyframes: KeyframeMemory | None = None
    random: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))

    @staticmethod
    def begin(mesh: Mesh, centred: Pose, config: TrackerConfig = DEFAULT) -> TrackState:
        """A track that starts at a pose which is taken to be right."""
        remembers = config.keyframes.enabled and not mesh.has_colours
        keyframes = KeyframeMemory(config.keyframes) if remembers else None
        track = TrackState(mesh, centred, centred, config)
        track.keyframes = track.sure_keyframes = keyframes
        return track

    def begin_again(self, centred: Pose, keyframes: KeyframeMemory | None) -> TrackState:
        """A track from another pose, which is taken to be right; what is known of colours stays.

        `keyframes` are those that are right whatever becomes of that pose.
        """
        again = TrackState.begin(self.mesh, self.nearest_equivalent(centred), self.config)
        again.begins = True
        again.histograms = self.histograms
        again.size, again.depth_bias = self.size, self.depth_bias
        again.keyframes = again.sure_keyframes = keyframes
        return again

    @property
    def pose(self) -> Pose:
        """The last pose in the mesh file's frame."""
        return self.mesh.outer(self.centred)

    def starts(self) -> list[Pose]:
        """Centred poses to start the next frame from, none twice; the last pose first."""
        found = [self.centred]
        if not self.config.motion.enabled:
            return found
        others = [] if self.velocity is None else [_ahead(self.centred, self.velocity)]
        if not self.above_low:
            others.append(self.last_confident)
        limit = self.config.multi_start.duplicate_delta
        for pose in others:
            if all(_differ(self.mesh, pose, other, limit) for other in found):
                found.append(pose)
        return found

    def recovery_poses(self) -> tuple[Pose, Pose, Pose]:
        """Where a lost object may be: the last pose, the last confident one, and ahead of that.

        Its velocity is taken to decay, so that the way has an end.
        """
        ahead = self.last_confident
        if self.mean_velocity is not None:
            decay = self.config.motion.velocity_decay
            frames = (1 - decay ** (self.frames_unconfident + 1)) / (1 - decay)
            ahead = _ahead(self.last_confident, frames * self.mean_velocity)
        return self.centred, self.last_confident, ahead

    def is_recovery_due(self) -> bool:
        """Whether a frame of low confidence now has recovery starts: the first ones, then a few."""
        config = self.config.multi_start
        later = self.frames_low - config.recovery_first + 1
        return later <= 0 or later % config.recovery_every == 0

    def add(self, centred: Pose, confidence: float) -> None:
        """Go on from the pose of the next frame.

        Of a symmetric object's poses it is the one turned least from the last: no can spins.
        """
        after = self.nearest_equivalent(centred)
        before, was_above_high = self.centred, self.above_high
        self.above_low = confidence >= self.config.low_confidence
        self.above_high = confidence >= self.config.high_confidence
        self.frames_low = 0 if self.above_low else self.frames_low + 1
        moved = self.above_high and not self.begins
        slow, self.begins = self.config.motion.slow_delta, False
        self.slow = moved and not _differ(self.mesh, before, after, slow)
        self.velocity = None
        if was_above_high and moved:
            turn = log_so3(after.rotation @ before.rotation.mT)
            self.velocity = torch.stack([turn, after.translation - before.translation])
        self.centred = after
        self.frames_unconfident += 1
        if self.above_high:
            self.last_confident, self.frames_unconfident = after, 0
            self._update_mean_velocity()

    def nearest_equivalent(self, centred: Pose) -> Pose:
        """The equivalent of a pose that is turned least from the last one."""
        if self.mesh.symmetries.is_trivial:
            return centred
        pose, last = self.mesh.outer(centred), self.pose
        return self.mesh.inner(nearest_equivalent(pose, last, self.mesh.closed_symmetries))

    def update_histograms(self, histograms: ColourHistograms | None) -> None:
        """Blend in the colours of a frame, if there are any and its confidence was not low."""
        if histograms is not None and self.above_low:
            known, rate = self.histograms, self.config.contour.histogram_rate
            self.histograms = histograms if known is None else known.blend(histograms, rate)

    def miss(self) -> None:
        """A frame without a pose: stay where the object was."""
        self.above_low, self.above_high, self.slow, self.velocity = False, False, False, None
        self.frames_unconfident += 1
        self.frames_low += 1

    def _update_mean_velocity(self) -> None:
        """The mean of the last velocities; none after a gap, in which it may have changed."""
        known, self.mean_velocity = self.mean_velocity, self.velocity
        if known is not None and self.velocity is not None:
            rate = self.config.motion.velocity_rate
            self.mean_velocity = torch.lerp(known, self.velocity, rate)


def _ahead(centred: Pose, velocity: Tensor) -> Pose:
    """A centred pose after a rotation vector and a shift (2, 3)."""
    return Pose(exp_so3(velocity[0]) @ centred.rotation, centred.translation + velocity[1])


def _differ(mesh: Mesh, one: Pose, other: Pose, limit: float) -> bool:
    """Whether two centred poses differ by more than so many action units on some axis."""
    if float(one.translation[2]) <= 0 or float(other.translation[2]) <= 0:
        return True
    diameter = torch.tensor(mesh.sphere_diameter, dtype=torch.float64)
    return bool(pose_delta(one, other, diameter).abs().max() > limit)
