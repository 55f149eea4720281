"""Where an object may be: the poses from which a tracker starts the next frame, places around them.

Never sees an image. METHOD 9f: a constant-velocity start beside the last pose, and the way back to
where the object was last seen well.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import torch
from torch import Tensor

from ..actions import PoseAction, difference
from ..geometry.equivalent import nearest_equivalent
from ..geometry.mesh import Mesh
from ..geometry.pose import Pose
from ..geometry.rotation import exp_so3, log_so3
from ..regions import Colours

# Confidence under which a pose is not believed.
DOUBTFUL = 0.5
# Confidence from which a motion is continued, a pose is gone back to, and a single image's is kept.
# Between the two an object is half covered or smeared, and what seems to be its motion runs away
# with the track.
SURE = 0.65
# Counts on every axis that an object, surely seen, may have moved by for the next frame to look
# closely at once (`loop.ZOOM`).
STEADY = 6.0
# Two starts within so many counts on every axis lead to the same place: one of them is enough.
SAME = 3.0
# Part of the colours that each frame replaces (SRT3D's learning rates).
LEARNING = 0.2
# Part of the motion that each sure frame replaces, and part of it that an unseen object is taken to
# keep from frame to frame.
MOTION_LEARNING = 0.5
PERSISTENCE = 0.93


@dataclass(frozen=True)
class Around:
    """Places at random around a pose: how many, how far away, and whether to look closely at once.

    `shift` are the most counts aside, up or down, nearer or farther; `turn` the degrees from, to.
    """

    count: int
    shift: tuple[float, float, float]
    turn: tuple[float, float]
    close: bool = False


@dataclass
class Track:
    """What a tracker remembers of one object; poses are the mesh file's, float64.

    `pose` is the last one found, `velocity` (2, 3) its last turn (radians) and shift (metres) from
    frame to frame about the object's centre, `trusted` the last one that was sure, `motion` (2, 3)
    the mean velocity up to it and `unsure` the number of frames since; `steady` says that it is the
    last one and hardly moved; `colours` are the object's and its surroundings' in the frames that
    were believed, `depth_bias` what the policy is known to be off by when it looks closely
    (`calibration`).
    """

    mesh: Mesh
    pose: Pose
    trusted: Pose
    velocity: Tensor | None = None
    motion: Tensor | None = None
    unsure: int = 0
    believed: bool = True
    sure: bool = True
    steady: bool = False
    colours: Colours | None = None
    depth_bias: float = 0.0
    random: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))

    @staticmethod
    def begin(mesh: Mesh, pose: Pose) -> Track:
        """A track that starts at a pose which is taken to be right."""
        return Track(mesh, pose, pose)

    def starts(self) -> list[Pose]:
        """Poses to start the next frame from, each far from the others; the last pose first."""
        found = [self.pose]
        others = [] if self.velocity is None else [self._ahead(self.pose, self.velocity)]
        if not self.believed:
            others.append(self.trusted)
        for pose in others:
            if all(_apart(self.mesh, pose, other) for other in found):
                found.append(pose)
        return found

    def likely(self) -> tuple[Pose, Pose, Pose]:
        """Where an object in doubt may be: where it was last, where it was sure, and ahead of that.

        On its way from there it is taken to slow down, so that the way has an end.
        """
        ahead = self.trusted
        if self.motion is not None:
            frames = (1 - PERSISTENCE ** (self.unsure + 1)) / (1 - PERSISTENCE)
            ahead = self._ahead(self.trusted, frames * self.motion)
        return self.pose, self.trusted, ahead

    def add(self, pose: Pose, confidence: float) -> None:
        """Go on from the pose of the frame that came.

        Of a symmetric object's poses it is the one turned least from the last: no can spins.
        """
        pose = nearest_equivalent(pose, self.pose, self.mesh.symmetries)
        before, after = self.mesh.inner(self.pose), self.mesh.inner(pose)
        was_sure = self.sure
        self.believed, self.sure = confidence >= DOUBTFUL, confidence >= SURE
        self.steady = self.sure and not _apart(self.mesh, self.pose, pose, STEADY)
        self.velocity = None
        if was_sure and self.sure:
            turn = log_so3(after.rotation @ before.rotation.mT)
            self.velocity = torch.stack([turn, after.translation - before.translation])
        self.pose = pose
        self.unsure += 1
        if self.sure:
            self.trusted, self.unsure = pose, 0
            self._learn_motion()

    def learn(self, colours: Colours | None) -> None:
        """Remember the colours of a frame, if there are any and its pose was believed."""
        if colours is not None and self.believed:
            known = self.colours
            self.colours = colours if known is None else known.blend(colours, LEARNING)

    def miss(self) -> None:
        """A frame without a pose: stay where the object was."""
        self.believed, self.sure, self.steady, self.velocity = False, False, False, None
        self.unsure += 1

    def _learn_motion(self) -> None:
        """The mean of the last velocities; none after a gap, in which it may have changed."""
        known, self.motion = self.motion, self.velocity
        if known is not None and self.velocity is not None:
            self.motion = torch.lerp(known, self.velocity, MOTION_LEARNING)

    def _ahead(self, pose: Pose, motion: Tensor) -> Pose:
        """A pose after a motion (2, 3), a turn and a shift."""
        here = self.mesh.inner(pose)
        ahead = Pose(exp_so3(motion[0]) @ here.rotation, here.translation + motion[1])
        return self.mesh.outer(ahead)


def _apart(mesh: Mesh, one: Pose, other: Pose, counts: float = SAME) -> bool:
    """Whether two poses differ by more than so many counts on some axis."""
    a, b = mesh.inner(one), mesh.inner(other)
    if float(a.translation[2]) <= 0 or float(b.translation[2]) <= 0:
        return True
    diameter = torch.tensor(mesh.sphere_diameter, dtype=torch.float64)
    return bool(difference(a, b, diameter).abs().max() > counts)


def beside(mesh: Mesh, pose: Pose, random: np.random.Generator, around: Around) -> Pose:
    """A pose at random around another one; both in the mesh file's frame."""
    axis = random.normal(size=3)
    axis *= random.uniform(*around.turn) / np.linalg.norm(axis)
    counts = torch.from_numpy(np.concatenate([random.uniform(-1, 1, 3) * around.shift, axis]))
    diameter = torch.tensor(mesh.sphere_diameter, dtype=torch.float64)
    centred = mesh.inner(pose.to(torch.float64))
    return mesh.outer(PoseAction.of(counts).apply(centred, diameter))
