"""After the loop: a result's pose with the outline fitted to the colours.

Never moves a pose far and never changes how sure the policy is.
"""

from __future__ import annotations

import time
from dataclasses import replace

from ..contour import ColourHistograms, refine_contour
from ..rendering.renderer import Renderer
from .frame import prepare_frame
from .refine import Target, TrackingResult


def refine_result(
    target: Target,
    result: TrackingResult,
    renderer: Renderer,
    histograms: ColourHistograms | None = None,
) -> tuple[TrackingResult, ColourHistograms | None]:
    """The result for a target after contour refinement, and the colour histograms there.

    `colours` are those of frames before; without them the image's own must do. A failed result
    stays as it is.
    """
    if result.pose is None:
        return result, None
    begin = time.perf_counter()
    frame = prepare_frame(target.image, target.camera)
    given = target.mesh.inner(result.pose)
    found = refine_contour(
        frame.pixels, frame.camera.matrix(), target.mesh, given, renderer, histograms
    )
    spent = (time.perf_counter() - begin) * 1e3
    pose, milliseconds = target.mesh.outer(found.pose), result.milliseconds + spent
    return replace(result, pose=pose, milliseconds=milliseconds), found.histograms
