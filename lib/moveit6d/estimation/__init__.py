"""One frame (`PoseEstimator`), a video (`PoseTracker`), many single targets (`refine_single`).

`refine_batch` is the loop alone, `PoseDetector` finds a pose where there is no start
(`SeedDetector` in the paper's own way).

Never knows a network, only policies.
"""

from .detection import Detection, DetectorConfig, PoseDetector, SearchRegion, TemplateStore
from .estimator import PoseEstimator, refine_single
from .refine import StopReason, Target, TrackingResult, refine_batch
from .seed_detector import SeedDetection, SeedDetector, SeedDetectorConfig, SelectionCriterion
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
    "TrackingResult",
    "refine_batch",
    "refine_single",
]
