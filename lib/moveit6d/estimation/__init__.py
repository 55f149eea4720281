"""The loop: one frame (`PoseEstimator`), a video (`PoseTracker`), many targets (`refine_batch`).

Never knows a network, only policies.
"""

from .estimator import PoseEstimator
from .loop import StopReason, Target, TrackingResult, refine_batch
from .tracker import PoseTracker

__all__ = [
    "PoseEstimator", "PoseTracker", "StopReason", "Target", "TrackingResult", "refine_batch",
]  # fmt: skip
