"""Region-based refinement: the contour of the object, fitted to where its colours end.

What region-based trackers do (Stoiber et al., SRT3D, IJCV 2022), after the network's
iterations. Never knows a network and never remembers anything; trackers keep the colours.
"""

from .histograms import ColourHistograms, estimate_histograms
from .refinement import ContourRefinement, histograms_at, refine_contour

__all__ = [
    "ColourHistograms",
    "ContourRefinement",
    "estimate_histograms",
    "histograms_at",
    "refine_contour",
]
