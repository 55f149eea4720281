"""moveit6d follows an object's 6D pose through a video, from its mesh alone, by learned actions.

The public names; never imports what they need before they are used, and never touches a file.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .actions import ActionSpace, PoseAction
    from .config import PAPER_CONFIG, TrackerConfig
    from .datasets.live import LatestFrames
    from .datasets.video import open_frames
    from .errors import InputError
    from .estimation import PoseDetector, PoseEstimator, PoseTracker, TrackingResult
    from .estimation.detection import detect_objects
    from .geometry.camera import Camera
    from .geometry.mesh import Mesh
    from .geometry.pose import Pose
    from .policies import OraclePolicy, load_policy
    from .rendering import make_renderer
    from .visualization.overlay import draw_pose
    from .visualization.video import VideoWriter

__version__ = "0.1.0"

# Each public name and the module that it lives in; loaded at first use (PEP 562).
_HOMES = {
    "Camera": "geometry.camera",
    "Mesh": "geometry.mesh",
    "Pose": "geometry.pose",
    "PoseAction": "actions",
    "ActionSpace": "actions",
    "PoseTracker": "estimation",
    "PoseEstimator": "estimation",
    "PoseDetector": "estimation",
    "detect_objects": "estimation.detection",
    "TrackingResult": "estimation",
    "TrackerConfig": "config",
    "PAPER_CONFIG": "config",
    "load_policy": "policies",
    "OraclePolicy": "policies",
    "make_renderer": "rendering",
    "open_frames": "datasets.video",
    "LatestFrames": "datasets.live",
    "draw_pose": "visualization.overlay",
    "VideoWriter": "visualization.video",
    "InputError": "errors",
}

__all__ = [
    "Camera",
    "Mesh",
    "Pose",
    "PoseAction",
    "ActionSpace",
    "PoseTracker",
    "PoseEstimator",
    "PoseDetector",
    "detect_objects",
    "TrackingResult",
    "TrackerConfig",
    "PAPER_CONFIG",
    "load_policy",
    "OraclePolicy",
    "make_renderer",
    "open_frames",
    "LatestFrames",
    "draw_pose",
    "VideoWriter",
    "InputError",
    "__version__",
]


def __getattr__(name: str) -> object:
    """A public name, loaded now; anything else is an `AttributeError` as usual."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value: object = getattr(import_module(f".{_HOMES[name]}", __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
