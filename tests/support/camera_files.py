"""Files of one camera."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from moveit6d.geometry.camera import Camera

WANTED = Camera(600, 610, 320, 240, 640, 480, (-0.3, 0.1, 0.001, 0.002, 0.01))


K = [[600.0, 0.0, 320.0], [0.0, 610.0, 240.0], [0.0, 0.0, 1.0]]


LENS = [-0.3, 0.1, 0.001, 0.002, 0.01]


def saved(folder: Path, name: str, content: Any) -> Path:
    path = folder / name
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path
