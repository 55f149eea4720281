"""From pictures of a printed board to a camera: boards, where their corners are, and the fit.

Never opens files or videos.
"""

from .boards import Board, Corners
from .solve import Calibration, LensKind, calibrate, choose_views

__all__ = ["Board", "Calibration", "Corners", "LensKind", "calibrate", "choose_views"]
