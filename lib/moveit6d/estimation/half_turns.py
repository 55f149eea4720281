"""Whether an object is seen turned by half about an axis of its box: cartons, tools and bottles.

Never searches an image. Where one side hardly tells, a search finds such objects upside down, and
the loop does not leave that pose. The network is more confident at the right one of the two, if
only by little (docs/results/detection.md): it is asked in several frames.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import torch

from ..config import LoopConfig, RecoveryConfig
from ..geometry.mesh import Mesh
from ..geometry.pose import Pose
from ..policies import Policy
from ..rendering.renderer import Renderer
from .refine import refine_starts
from .results import Refined, Start
from .states import log_odds


def half_turned(mesh: Mesh, centred: Pose) -> list[Pose]:
    """The centred poses of an object that is turned by half where it is: three at most.

    Turned by a declared symmetry it is where it was.
    """
    found = []
    for motion in mesh.half_turns:
        turn = torch.from_numpy(motion).to(centred.rotation)
        shift = centred.rotation @ turn[:3, 3] + centred.translation
        found.append(Pose(centred.rotation @ turn[:3, :3], shift))
    return found


def refined_half_turns(
    start: Start, *, policy: Policy, renderer: Renderer, loop: LoopConfig, target: int = 0
) -> list[Refined]:
    """Where the loop ends from the half turns of a start of the object with this number."""
    starts = [replace(start, centred=pose) for pose in half_turned(start.mesh, start.centred)]
    targets = [target] * len(starts)
    return refine_starts(starts, policy=policy, renderer=renderer, loop=loop, targets=targets)


def is_turned_over(before: Pose, after: Pose) -> bool:
    """Whether a pose is turned by more than a quarter turn from another."""
    trace = float((before.rotation * after.rotation).sum())  # 1 + 2 cos(angle)
    return trace < 1


@dataclass
class HalfTurnCheck:
    """The comparison of a pose that was found with its half turns, over the frames after.

    >>> check = HalfTurnCheck(RecoveryConfig(half_turn_frames=2, half_turn_interval=3))
    >>> [check.is_due() for _ in range(7)]
    [True, False, False, True, False, False, False]
    """

    config: RecoveryConfig = field(default_factory=RecoveryConfig)
    _frames: int = 0
    _evidence: list[float] = field(default_factory=list)

    def restart(self) -> None:
        """Forget all frames so far: the object is followed from another pose."""
        self._evidence = []

    def is_due(self) -> bool:
        """Whether the half turns are to be tried in this frame; to be asked once a frame."""
        number, rest = divmod(self._frames, self.config.half_turn_interval)
        self._frames += 1
        return rest == 0 and number < self.config.half_turn_frames

    def better(self, own: float, turned: Sequence[float]) -> int | None:
        """Which half turn is more likely by all frames so far, given a frame's confidences.

        None for the pose itself. After a change the comparison starts anew.
        """
        if not turned:
            return None
        known = self._evidence or [0.0] * len(turned)
        self._evidence = [
            so_far + log_odds(one) - log_odds(own)
            for so_far, one in zip(known, turned, strict=True)
        ]
        best = max(range(len(turned)), key=self._evidence.__getitem__)
        if self._evidence[best] <= self.config.half_turn_evidence:
            return None
        self.restart()
        return best


def likelier_half_turn(
    check: HalfTurnCheck,
    start: Start,
    confidence: float,
    *,
    policy: Policy,
    renderer: Renderer,
    loop: LoopConfig,
    target: int = 0,
) -> Refined | None:
    """Where the loop ends from that half turn of a pose which is likelier than the pose, if any.

    `start` is the pose, `confidence` its own. Tried in the frames that the check asks for.
    """
    if not check.is_due():
        return None
    turned = refined_half_turns(start, policy=policy, renderer=renderer, loop=loop, target=target)
    best = check.better(confidence, [one.confidence for one in turned])
    return None if best is None else turned[best]
