"""The settings of detection refuse what cannot be right, and say which field it is."""

from __future__ import annotations

from typing import Any

import pytest

from moveit6d.config import (
    DetectorConfig,
    MatchConfig,
    RegionConfig,
    SeedDetectorConfig,
    TemplateConfig,
)
from moveit6d.errors import InputError


@pytest.mark.parametrize(
    ("kind", "given", "message"),
    [
        (TemplateConfig, {"channels": 0}, "channels must be 1 or more"),
        (TemplateConfig, {"width": 60}, "widths must be multiples of 8"),
        (TemplateConfig, {"coarse_width": 0}, "widths must be multiples of 8"),
        (TemplateConfig, {"distance": 0.5}, "distance must be 1"),
        (MatchConfig, {"widths": (0.5, 0.1)}, "widths must be two positive shares"),
        (MatchConfig, {"views": 0}, "places and views must be 1"),
        (MatchConfig, {"more_places": -1}, "more_places must be 0 or more"),
        (MatchConfig, {"neighbourhood": 4}, "neighbourhood must be an odd number of cells"),
        (MatchConfig, {"background": 1}, "samples and background must be 2"),
        (MatchConfig, {"samples": 1}, "samples and background must be 2"),
        (RegionConfig, {"box_ratio": (1.2, 2.5)}, "box_ratio must be two"),
        (RegionConfig, {"margin": -0.1}, "margin 0 or more"),
        (RegionConfig, {"stages": ((48, 2), (0, 3))}, "stages must be one or more pairs"),
        (DetectorConfig, {"stages": ()}, "stages must be one or more pairs"),
        (DetectorConfig, {"accepted": 1.5}, "accepted must be a probability"),
        (SeedDetectorConfig, {"sizes": ()}, "sizes must be positive shares"),
        (SeedDetectorConfig, {"sinks": 0}, "poses, sinks and rotations must be 1"),
        (SeedDetectorConfig, {"max_seeds": 2}, "max_seeds 3 or more"),
        (SeedDetectorConfig, {"criterion": "luck"}, "no criterion 'luck'"),
    ],
)
def test_what_cannot_be_right_is_refused(kind: type, given: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=f"{kind.__name__}: .*{message}"):
        kind(**given)
