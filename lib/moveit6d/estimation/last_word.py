"""After the loop: a result's pose with the outline fitted to the colours.

Never moves a pose far and never changes how sure the policy is.
"""

from __future__ import annotations

import time
from dataclasses import replace

from ..regions import Colours, polish
from ..rendering.renderer import Renderer
from .frame import prepare_frame
from .loop import Target, TrackingResult


def last_word(
    target: Target, result: TrackingResult, renderer: Renderer, colours: Colours | None = None
) -> tuple[TrackingResult, Colours | None]:
    """The result for a target with its pose polished, and the colours of the image there.

    `colours` are those of frames before; without them the image's own must do. A failed result
    stays as it is.
    """
    if result.pose is None:
        return result, None
    begin = time.perf_counter()
    frame = prepare_frame(target.image, target.camera)
    given = target.mesh.inner(result.pose)
    found = polish(
        frame.pixels, frame.camera.matrix(), target.mesh, given, renderer, colours,
        frame.camera.lens,
    )  # fmt: skip
    spent = (time.perf_counter() - begin) * 1e3
    pose, milliseconds = target.mesh.outer(found.pose), result.milliseconds + spent
    return replace(result, pose=pose, milliseconds=milliseconds), found.colours
