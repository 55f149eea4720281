"""Detection: an object's pose in an image from nothing, or from a box, a mask, clicks, a distance.

Never tracks. `PoseDetector` is the door; the paper's own way is in `estimation.seed_detector`.
"""

from .detector import PoseDetector, can_search, detect_objects
from .found import Detection, FoundPose
from .region import SearchRegion
from .templates import TemplateStore, default_store
from .verification import Evidence

__all__ = [
    "Detection",
    "Evidence",
    "FoundPose",
    "PoseDetector",
    "SearchRegion",
    "TemplateStore",
    "can_search",
    "default_store",
    "detect_objects",
]
