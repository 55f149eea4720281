"""After the loop: region-based refinement of a result's pose.

Never moves a pose far and never changes its confidence.
"""

from __future__ import annotations

import time
from dataclasses import replace

from ..config import ContourConfig
from ..contour import ColourHistograms, refine_contour
from ..frame import Frame
from ..geometry.mesh import Mesh
from ..rendering.renderer import Renderer
from .results import Refined


def refine_result(
    frame: Frame,
    mesh: Mesh,
    result: Refined,
    renderer: Renderer,
    config: ContourConfig,
    histograms: ColourHistograms | None = None,
) -> tuple[Refined, ColourHistograms | None]:
    """A result in a frame after contour refinement, and the frame's colour histograms there.

    `histograms` are those of frames before; without them the image's own must do. A failed result
    stays as it is, and so does every result if the refinement is not enabled. One of which the
    network is sure (`ContourConfig.moves_below`) keeps its pose.
    """
    if result.centred is None or not config.enabled:
        return result, None
    begin = time.perf_counter()
    found = refine_contour(
        frame.pixels,
        frame.intrinsics,
        mesh,
        result.centred,
        renderer,
        histograms,
        config,
        frame.camera.lens,
        moves=result.confidence < config.moves_below,
    )
    spent = (time.perf_counter() - begin) * 1e3
    refined = replace(
        result,
        centred=found.pose,
        milliseconds=result.milliseconds + spent,
        contour_agreement=found.agreement,
    )
    return refined, found.histograms
