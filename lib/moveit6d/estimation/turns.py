"""Which lost objects of a tracker are looked for in a frame, and in which order.

Never searches by itself.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence

from ..config import RecoveryConfig
from .recovery import Supervisor


class SearchTurns:
    """Lost objects take turns: a time limit holds for all searches of a frame together.

    Args:
        config: with a time limit, or without.
        same: of each object the others of the same mesh (`same_meshes`).
    """

    def __init__(self, config: RecoveryConfig, same: Sequence[Sequence[int]]) -> None:
        self.limited, self.same = config.max_milliseconds is not None, same
        self._first = 0

    def of_frame(self, supervisors: Sequence[Supervisor]) -> Iterator[tuple[int, float]]:
        """Objects to look for now, and the milliseconds that those before have taken.

        With a time limit who comes first in one frame comes last in the next one, and of instances
        of one mesh one is looked for at a time: both would find the same.
        """
        lost = [number for number, one in enumerate(supervisors) if one.lost]
        if lost and self.limited:
            self._first = (self._first + 1) % len(lost)
            lost = [*lost[self._first :], *lost[: self._first]]
        begin, spent = time.perf_counter(), 0.0
        for number in lost:
            if self.limited and any(supervisors[one].searching for one in self.same[number]):
                continue
            yield number, spent
            spent = (time.perf_counter() - begin) * 1e3
