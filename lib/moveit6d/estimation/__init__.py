"""One frame (`PoseEstimator`), a video (`PoseTracker`), many single targets (`refine_single`).

`refine_batch` is the loop alone, `PoseDetector` finds a pose where there is no start.

Never knows a network, only policies.
"""

from ..config import DetectorConfig, SeedDetectorConfig, SelectionCriterion, TrackerConfig
from .detection import Detection, PoseDetector, SearchRegion, TemplateStore
from .estimator import PoseEstimator, refine_single
from .lost_targets import search_lost_targets
from .refine import refine_batch
from .results import StopReason, Target, TrackingResult
from .seed_detector import SeedDetection, SeedDetector
from .states import TrackingState
from .tracker import PoseTracker

__all__ = [
    "Detection",
    "DetectorConfig",
    "PoseDetector",
    "PoseEstimator",
    "PoseTracker",
    "SearchRegion",
    "SeedDetection",
    "SeedDetector",
    "SeedDetectorConfig",
    "SelectionCriterion",
    "StopReason",
    "Target",
    "TemplateStore",
    "TrackerConfig",
    "TrackingResult",
    "TrackingState",
    "refine_batch",
    "refine_single",
    "search_lost_targets",
]
