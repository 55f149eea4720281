"""Which starts of a batch go on, in which stage, and when each one ends.

Never renders and never asks a policy. Coarse to fine: a start enters the fine stage once its delta
is small, or when its loop would end. Racing: of several starts for one object the one with the
most confident first iteration goes on.
"""

from __future__ import annotations

import time
from collections.abc import Sequence

import torch
from torch import Tensor

from ..actions import PoseAction, pose_delta
from ..config import ActionMode, LoopConfig
from ..geometry.crop import Crop
from ..geometry.pose import Pose
from ..geometry.visibility import why_unseen
from .covariance import Information
from .localizability import localizability
from .results import Refined, Start, StopReason
from .visibility import start_problem


class Trajectory:
    """The centred poses that one start has visited, and whether the next one ends its loop."""

    def __init__(
        self, start: Start, loop: LoopConfig, mode: ActionMode, crop: Crop = "look_at"
    ) -> None:
        self.start, self.loop, self.mode, self.crop = start, loop, mode, crop
        self.error = ""
        self.poses: list[Pose] = []
        self.confidences: list[float] = []
        self.information: list[Information | None] = []
        self.highest = -1.0  # confidence
        self.best = -1

    def add(
        self,
        centred: Pose,
        diameter: Tensor,
        stop: bool,
        confidence: float,
        information: Tensor | None,
    ) -> StopReason | None:
        """Record the pose after an update; the reason to end now, if there is one.

        `diameter` is that of the sphere, metres, that filled the crop; `information` (6, 6) is the
        update's (`PolicyOutput`).
        """
        self.error = "an update led to numbers that are not finite"
        if torch.isfinite(centred.translation).all():
            mesh, camera = self.start.mesh, self.start.frame.camera
            self.error = why_unseen(centred, mesh, camera) or ""
        if self.error:
            return StopReason.FAILED
        first = self._revisited(centred, diameter)
        self.poses.append(centred)
        self.confidences.append(confidence)
        known = None
        if information is not None:
            error = self.loop.displacement_error
            known = Information(information, diameter, self.crop, error)
        self.information.append(known)
        self.highest = max(self.highest, confidence)
        if stop or first is None:
            self.best = len(self.poses) - 1
            return StopReason.STOP_ACTION if stop else None
        self.best = max(range(first, len(self.poses)), key=lambda i: self.confidences[i])
        return StopReason.REVISITED

    def restart(self) -> None:
        """Forget the poses so far: in the fine stage the same pose means a smaller difference."""
        self.poses, self.confidences, self.information, self.best = [], [], [], -1

    def refined(self, reason: StopReason, iterations: int, milliseconds: float) -> Refined:
        """The outcome."""
        if reason is StopReason.FAILED or not self.poses:
            # What to check is for starts; a loop that got here began well.
            error = f"The object is lost: {self.error.split(';')[0]}."
            return Refined(None, iterations, StopReason.FAILED, 0.0, milliseconds, error)
        centred, confidence = self.poses[self.best], self.confidences[self.best]
        mesh, camera = self.start.mesh, self.start.frame.camera
        known = localizability(centred, mesh, camera, self.loop.width_error)
        return Refined(
            centred, iterations, reason, confidence, milliseconds,
            localizability=known, information=self.information[self.best],
        )  # fmt: skip

    def _revisited(self, centred: Pose, diameter: Tensor) -> int | None:
        """The first earlier pose that is the same (`LoopConfig.revisit_delta`)."""
        if not self.poses:
            return None
        earlier = Pose.stack(self.poses)
        here = Pose(
            centred.rotation.expand_as(earlier.rotation),
            centred.translation.expand_as(earlier.translation),
        )
        delta = pose_delta(here, earlier, diameter.expand(len(earlier)))
        same = (delta.abs().amax(-1) < self.loop.same_pose(self.mode)).nonzero()
        return int(same[0, 0]) if len(same) else None


class Schedule:
    """The state of a batch of starts (N) during a loop.

    `active` (M) are the rows that go on, `scale` (N) how many times larger each crop shows its
    object, `groups` (N) the object that each row is a start for.
    """

    def __init__(
        self,
        starts: Sequence[Start],
        loop: LoopConfig,
        mode: ActionMode,
        groups: Sequence[int] | None,
        crop: Crop = "look_at",
    ) -> None:
        self.begin, self.loop, self.limit = time.perf_counter(), loop, loop.limit(mode)
        self.coarse_to_fine = loop.fine_stage and mode is ActionMode.ALL_AXES
        self.trajectories = [Trajectory(start, loop, mode, crop) for start in starts]
        self.outcomes: list[Refined | None] = [_unseen(start) for start in starts]
        fine = [self.coarse_to_fine and start.fine for start in starts]
        self.scale = torch.tensor([loop.fine_scale if one else 1.0 for one in fine])
        self.fine = torch.tensor(fine, dtype=torch.bool)
        rows = torch.arange(len(starts))
        self.racing = groups is not None
        self.groups = rows if groups is None else torch.as_tensor(groups)
        self.active = rows[[outcome is None for outcome in self.outcomes]]
        self.iteration = 0

    def advance(
        self,
        centred: Pose,
        diameter: Tensor,
        action: PoseAction,
        confidence: Tensor,
        information: Tensor | None = None,
    ) -> None:
        """Take note of the active rows' poses (M) after an update, and choose who goes on.

        `diameter` (M,) are those of the spheres that filled the crops; `information` (M, 6, 6) is
        the updates' (`PolicyOutput`).
        """
        self.iteration += 1
        going = []
        for row, i in enumerate(self.active.tolist()):
            stop = bool(action.stop[row])
            end = self.trajectories[i].add(
                centred[row],
                diameter[row],
                stop,
                float(confidence[row]),
                None if information is None else information[row],
            )
            if self._reaches_fine_stage(i, action.delta[row], end):
                self.scale[i], self.fine[i], end = self.loop.fine_scale, True, None
                self.trajectories[i].restart()
            if end is None and self.iteration == self.limit:
                end = StopReason.MAX_ITERATIONS
            if end is None:
                going.append(row)
                continue
            spent = (time.perf_counter() - self.begin) * 1e3
            self.outcomes[i] = self.trajectories[i].refined(end, self.iteration, spent)
        self.active = self.active[going]
        if self.iteration == 1:
            self._race()

    def results(self) -> list[Refined]:
        """One outcome for each start, or for each group where several starts race."""
        if self.iteration == 0:
            self._race()
        return [outcome for outcome in self.outcomes if outcome is not None]

    def _reaches_fine_stage(self, row: int, delta: Tensor, end: StopReason | None) -> bool:
        """Whether a row enters the fine stage now; `end` is why its loop would end."""
        if not self.coarse_to_fine or self.fine[row] or end is StopReason.FAILED:
            return False
        left = self.limit - self.iteration
        near = end is not None or bool(delta.abs().max() < self.loop.fine_threshold)
        return (near and left > 0) or left == 1

    def _race(self) -> None:
        """Of each group keep the start with the most confident first iteration."""
        if not self.racing:
            return
        members: dict[int, list[int]] = {}
        for i, group in enumerate(self.groups.tolist()):
            members.setdefault(group, []).append(i)
        chosen = {
            max(rows, key=lambda i: self.trajectories[i].highest) for rows in members.values()
        }
        self.outcomes = [
            outcome if i in chosen else None for i, outcome in enumerate(self.outcomes)
        ]
        self.active = self.active[[i in chosen for i in self.active.tolist()]]


def _unseen(start: Start) -> Refined | None:
    """The failure of a start that the camera cannot see."""
    problem = start_problem(start.centred, start.mesh, start.frame.camera)
    return None if problem is None else Refined(None, 0, StopReason.FAILED, 0.0, 0.0, problem)
