"""After the loop: region-based refinement of a result's pose.

Never moves a pose far and never changes its confidence.
"""

from __future__ import annotations

import time
from dataclasses import replace

from ..config import ContourConfig
from ..contour import ColourHistograms, refine_contour
from ..rendering.renderer import Renderer
from .results import Refined, Start


def refine_result(
    start: Start,
    result: Refined,
    renderer: Renderer,
    config: ContourConfig,
    histograms: ColourHistograms | None = None,
) -> tuple[Refined, ColourHistograms | None]:
    """A start's result after contour refinement, and the colour histograms of the image there.

    `histograms` are those of frames before; without them the image's own must do. A failed result
    stays as it is, and so does every result if the refinement is not enabled.
    """
    if result.centred is None or not config.enabled:
        return result, None
    begin = time.perf_counter()
    frame = start.frame
    found = refine_contour(
        frame.pixels,
        frame.intrinsics,
        start.mesh,
        result.centred,
        renderer,
        histograms,
        config,
        frame.camera.lens,
    )
    spent = (time.perf_counter() - begin) * 1e3
    milliseconds = result.milliseconds + spent
    return replace(result, centred=found.pose, milliseconds=milliseconds), found.histograms
