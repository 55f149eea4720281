"""The frames of a sequence whose true pose is known.

Never tracks.
"""

from __future__ import annotations

from collections.abc import Iterator

import torch

from moveit6d.datasets.sequences import Sequence
from moveit6d.frame import Frame, prepare_frame
from moveit6d.geometry.pose import Pose


def true_frames(sequence: Sequence, every: int) -> Iterator[tuple[Frame, Pose]]:
    """Every `every`-th frame that can be read, and its true pose (mesh file's frame, float64)."""
    for number, one in enumerate(sequence.open()):
        truth = sequence.truth.get(one.index)
        if number % every == 0 and truth is not None and one.image is not None:
            yield prepare_frame(one.image, sequence.camera), truth.to(torch.float64)
