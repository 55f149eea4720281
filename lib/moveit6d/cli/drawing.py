"""The picture of one tracked frame, as in overlay.mp4.

Never decides what is drawn how; `visualization` does.
"""

from __future__ import annotations

from collections.abc import Sequence

from ..datasets.video import Image
from ..evaluation.run_tracker import TrackedFrame
from ..geometry.camera import Camera
from ..geometry.mesh import Mesh
from ..rendering.renderer import Renderer
from ..visualization.overlay import GREEN, RED, blank, draw_pose, draw_text


def draw_step(
    step: TrackedFrame, meshes: Mesh | Sequence[Mesh], camera: Camera, renderer: Renderer
) -> Image:
    """The picture of one frame of overlay.mp4: outlines, axes and a line of text an object."""
    objects = [meshes] if isinstance(meshes, Mesh) else list(meshes)
    image = blank(camera) if step.frame.image is None else step.frame.image
    steps = (step, *step.others)
    for one, mesh in zip(steps, objects, strict=True):
        if one.row.pose is not None:
            color = GREEN if one.confident else RED
            image = draw_pose(image, mesh, one.row.pose, camera, renderer, color=color)
    for line, one in enumerate(steps):
        image = draw_text(image, _text(one), GREEN if one.confident else RED, line)
    return image


def _text(step: TrackedFrame) -> str:
    row = step.row
    name = f"{row.object}  " if row.object else ""
    if row.pose is None:
        return f"{name}frame {row.frame}  {'lost' if row.state == 'lost' else 'no pose'}"
    iterations = "1 iteration" if row.iterations == 1 else f"{row.iterations} iterations"
    text = f"{name}frame {row.frame}  confidence {row.confidence or 0:.2f}  {iterations}"
    return f"{text}  uncertain" if row.state == "uncertain" else text
