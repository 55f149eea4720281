"""Every setting of tracking and detection, with its default and what it does.

Never imports torch and never computes anything: a configuration is plain data, to be written to
files, compared and sent to other processes.
"""

from .calibration import CalibrationConfig
from .detection import (
    DetectorConfig,
    MatchConfig,
    RegionConfig,
    SeedDetectorConfig,
    SelectionCriterion,
    TemplateConfig,
    VerificationConfig,
)
from .loop import MAX_ITERATIONS, ActionMode, LoopConfig, Mode
from .recovery import RecoveryConfig, SecondLookConfig, StateConfig
from .tracking import (
    PAPER_CONFIG,
    ContourConfig,
    KeyframeConfig,
    MotionConfig,
    MultiStartConfig,
    PerturbationConfig,
    SingleImageConfig,
    TextureConfig,
    TrackerConfig,
)

__all__ = [
    "MAX_ITERATIONS",
    "PAPER_CONFIG",
    "ActionMode",
    "CalibrationConfig",
    "ContourConfig",
    "DetectorConfig",
    "KeyframeConfig",
    "LoopConfig",
    "MatchConfig",
    "Mode",
    "MotionConfig",
    "MultiStartConfig",
    "PerturbationConfig",
    "RecoveryConfig",
    "RegionConfig",
    "SecondLookConfig",
    "SeedDetectorConfig",
    "SelectionCriterion",
    "SingleImageConfig",
    "StateConfig",
    "TemplateConfig",
    "TextureConfig",
    "TrackerConfig",
    "VerificationConfig",
]
