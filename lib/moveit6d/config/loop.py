"""Settings of the refinement loop.

Never computes anything.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Literal

from ..errors import InputError
from .ranges import check_range


class ActionMode(StrEnum):
    """How a prediction becomes a `PoseAction`."""

    SINGLE = "single"  # the paper: the best of the 13 actions, one step size long
    ALL_AXES = "all_axes"  # all six axes of the real-valued delta at once


Mode = Literal["single", "all_axes"]

# The paper's limit for single actions. With all axes at once 74.4, 76.9 and 76.2 % of far starts,
# a third of them occluded, end below 10 % of the diameter with six, eight and eleven.
MAX_ITERATIONS = {ActionMode.SINGLE: 30, ActionMode.ALL_AXES: 8}


@dataclass(frozen=True)
class LoopConfig:
    """The refinement loop.

    Args:
        mode: single (the paper's: one of 13 actions an iteration) or all_axes (the whole pose delta
            at once); None takes the policy's own.
        max_iterations: limit for one frame; None means 30 in mode single and 8 in mode all_axes.
        step_size: length of single actions, in action units.
        fine_stage: near the object the crop shows its middle, enlarged (mode all_axes only).
        fine_scale: how many times larger the fine stage shows the object, which makes action units
            as many times smaller.
        fine_threshold: the fine stage begins once the delta is below this on every axis.
        augment: single images get one more iteration with test-time augmentation (mode all_axes).
        augment_size: side of that iteration's crops, pixels, a multiple of 32 from 128 on: larger
            ones show all of the object in the fine stage. Of compact networks; others' are 128.
        stop_delta: in mode all_axes the loop also stops once the delta is below this on every axis,
            in step sizes.
        revisit_delta: a pose that differs from an earlier one by less than this on every axis, in
            action units, is the same, and ends the loop; in step sizes in mode single, where they
            are smaller.
        least_shown: pixels of the rendering; with fewer there is nothing to compare, and the
            confidence is 0.
        width_error: standard deviation of an object's width in the image, pixels, that mesh, lens
            and intrinsics leave open; real data sets call their true poses good to 1 to 2 pixels.
            Only the reported localizability depends on it.
        displacement_error: standard deviation of the displacements that a network answers for the
            cells of its patch, patch pixels, and larger as neighbours err alike
            (`tools/fit_covariance.py`). Only the reported covariance depends on it.
    """

    mode: Mode | None = None
    max_iterations: int | None = None
    step_size: float = 1.0
    fine_stage: bool = True
    fine_scale: float = 1.6
    fine_threshold: float = 5.0
    augment: bool = True
    augment_size: int = 192
    stop_delta: float = 0.5
    revisit_delta: float = 0.5
    least_shown: int = 16
    width_error: float = 1.25
    displacement_error: float = 3.0

    def __post_init__(self) -> None:
        if self.mode is not None and self.mode not in list(ActionMode):
            raise InputError(
                f"LoopConfig: there is no mode {self.mode!r}; choose one of "
                f"{', '.join(ActionMode)}."
            )
        if self.max_iterations is not None and self.max_iterations < 1:
            raise InputError(
                f"LoopConfig: max_iterations must be 1 or more, found {self.max_iterations}."
            )
        if not self.step_size > 0 or not self.fine_scale >= 1:
            raise InputError(
                "LoopConfig: step_size must be positive and fine_scale 1 or more, found "
                f"{self.step_size} and {self.fine_scale}."
            )
        check_range(self, "0 or more", "least_shown")
        if self.augment_size < 128 or self.augment_size % 32:
            raise InputError(
                "LoopConfig: augment_size must be a multiple of 32 and 128 or more, found "
                f"{self.augment_size}."
            )
        for name in ("width_error", "displacement_error"):
            if not getattr(self, name) > 0:
                raise InputError(
                    f"LoopConfig: {name} must be positive pixels, found {getattr(self, name)}."
                )

    def limit(self, mode: ActionMode) -> int:
        """The limit of iterations in a mode."""
        return MAX_ITERATIONS[mode] if self.max_iterations is None else self.max_iterations

    def same_pose(self, mode: ActionMode) -> float:
        """Action units below which, on every axis, a pose is an earlier one again in a mode."""
        return self.revisit_delta * (min(1, self.step_size) if mode is ActionMode.SINGLE else 1)
