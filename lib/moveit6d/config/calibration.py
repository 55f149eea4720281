"""Settings of the calibration from an exact first pose.

Never computes anything.
"""

from __future__ import annotations

from dataclasses import dataclass

from ..errors import InputError
from .ranges import check_range


@dataclass(frozen=True)
class CalibrationConfig:
    """Calibration from a frame in which the pose is exact.

    Args:
        enabled: calibrate where a command is told that the first pose is exact.
        pairs: perturbed starts to either side of the known pose.
        spread: standard deviation of those starts on the six axes, in action units.
        size_share: part of the object's difference in size from its mesh, as the policy sees it in
            one frame, that lasts; the rest belongs to that view.
        size_disagreement: standard deviation of the updates from those starts, in action units, at
            which half of that counts: where they lead to different depths, as of slender
            objects, what one frame says holds for that frame alone.
        least_gain: part of a change of the mesh's size by which the depth must move; where it is
            less, nothing is made of the size.
        max_size: largest change of the mesh's size: 0.06 makes it up to 6 % larger or smaller.
        share: as `size_share`, of the depth bias that is left with a mesh of that size.
        disagreement: as `size_disagreement`, of that bias.
        max_bias: largest depth bias, in action units: more is a pose that is not exact.
    """

    enabled: bool = True
    pairs: int = 4
    spread: tuple[float, float, float, float, float, float] = (1.0, 1.0, 1.0, 1.5, 1.5, 1.5)
    size_share: float = 0.85
    size_disagreement: float = 0.6
    least_gain: float = 0.3
    max_size: float = 0.06
    share: float = 0.3
    disagreement: float = 1.0
    max_bias: float = 3.0

    def __post_init__(self) -> None:
        check_range(self, "above 0", "size_disagreement", "disagreement", "least_gain")
        check_range(self, "0 or more", "pairs", "max_bias")
        check_range(self, "0 or more and finite", "spread")
        check_range(self, "from 0 to 1", "size_share", "share")
        if not 0 <= self.max_size < 1:
            raise InputError(
                f"CalibrationConfig: max_size must be 0 or more and below 1, found {self.max_size}."
            )
