"""One frame (`PoseEstimator`), a video (`PoseTracker`), many single targets (`refine_single`).

`refine_batch` is the loop alone, `PoseDetector` finds a pose where there is no start.

Never knows a network, only policies.
"""

from ..config import SeedDetectorConfig, SelectionCriterion, TrackerConfig
from .detector import Detection, PoseDetector
from .estimator import PoseEstimator, refine_single
from .refine import refine_batch
from .results import StopReason, Target, TrackingResult
from .tracker import PoseTracker

__all__ = [
    "Detection",
    "SeedDetectorConfig",
    "PoseDetector",
    "PoseEstimator",
    "PoseTracker",
    "SelectionCriterion",
    "StopReason",
    "Target",
    "TrackerConfig",
    "TrackingResult",
    "refine_batch",
    "refine_single",
]
