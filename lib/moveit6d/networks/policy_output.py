"""The one answer that every network and policy gives.

Never says how the answer was found.
"""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor


@dataclass(frozen=True)
class PolicyOutput:
    """What to do next, for a batch of B observations.

    `logits` (B, 13) score the actions of `ActionSpace`; `delta` (B, 6) are all six axes at once
    in action units, or None if the network only chooses single actions; `confidence` (B,) is the
    probability that the pose after the update is right; `attention` (B, 1, h, w) in
    [0, 1] says where the network looked, or None. `information` (B, 6, 6) is the inverse of the
    delta's covariance, but for the factor `LoopConfig.displacement_error`; None if that is unknown.
    """

    logits: Tensor
    delta: Tensor | None
    confidence: Tensor
    attention: Tensor | None = None
    information: Tensor | None = None
