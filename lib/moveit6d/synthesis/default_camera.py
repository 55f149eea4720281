"""The camera of everything that a benchmark renders for itself: 640×480, no lens error.

Never a camera of real data.
"""

from __future__ import annotations

from ..geometry.camera import Camera

CAMERA = Camera(600.0, 600.0, 319.5, 239.5, 640, 480)
