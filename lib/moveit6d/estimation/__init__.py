"""The loop: one frame (`PoseEstimator`), a video (`PoseTracker`), many targets (`refine_batch`).

`PoseDetector` finds a pose where there is no start.

Never knows a network, only policies.
"""

from .detector import Detection, Judge, PoseDetector, SearchConfig
from .estimator import PoseEstimator
from .loop import StopReason, Target, TrackingResult, refine_batch
from .tracker import PoseTracker

__all__ = [
    "Detection", "Judge", "PoseDetector", "PoseEstimator", "PoseTracker", "SearchConfig",
    "StopReason", "Target", "TrackingResult", "refine_batch",
]  # fmt: skip
