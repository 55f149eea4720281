"""One frame (`PoseEstimator`), a video (`PoseTracker`), many single targets (`refine_single`).

`refine_batch` is the loop alone, `PoseDetector` finds a pose where there is no start.

Never knows a network, only policies.
"""

from .detector import Detection, DetectorConfig, PoseDetector, SelectionCriterion
from .estimator import PoseEstimator, refine_single
from .refine import StopReason, Target, TrackingResult, refine_batch
from .tracker import PoseTracker

__all__ = [
    "Detection",
    "SelectionCriterion",
    "PoseDetector",
    "PoseEstimator",
    "PoseTracker",
    "DetectorConfig",
    "StopReason",
    "Target",
    "TrackingResult",
    "refine_batch",
    "refine_single",
]
