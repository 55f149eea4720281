"""Detection: an object's pose in an image from nothing, or from a box, a mask, clicks, a distance.

Never tracks. `PoseDetector` is the door; the paper's own way is `estimation.seed_detector`.
"""

from .config import DetectorConfig, JudgeConfig, MatchConfig, TemplateConfig
from .detector import Detection, FoundPose, PoseDetector, default_store, detect_objects
from .judge import Evidence
from .region import SearchRegion
from .templates import TemplateStore

__all__ = [
    "Detection", "DetectorConfig", "Evidence", "FoundPose", "JudgeConfig", "MatchConfig",
    "PoseDetector", "SearchRegion", "TemplateConfig", "TemplateStore", "default_store",
    "detect_objects",
]  # fmt: skip
