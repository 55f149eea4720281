"""The picture of one tracked frame, as in overlay.mp4.

Never decides what is drawn how; `visualization` does.
"""

from __future__ import annotations

from ..datasets.video import Image
from ..evaluation.run_tracker import TrackedFrame
from ..geometry.camera import Camera
from ..geometry.mesh import Mesh
from ..rendering.renderer import Renderer
from ..visualization.overlay import GREEN, RED, blank, draw_pose, draw_text


def draw_step(step: TrackedFrame, mesh: Mesh, camera: Camera, renderer: Renderer) -> Image:
    """The picture of one frame of overlay.mp4: outline, axes and a line of text."""
    row = step.row
    image = step.frame.image
    if image is None:
        image = blank(camera)
    if row.pose is None:
        return draw_text(image, f"frame {row.frame}  no pose", RED)
    color = GREEN if step.confident else RED
    iterations = "1 iteration" if row.iterations == 1 else f"{row.iterations} iterations"
    text = f"frame {row.frame}  confidence {row.confidence or 0:.2f}  {iterations}"
    picture = draw_pose(image, mesh, row.pose, camera, renderer, color=color)
    return draw_text(picture, text, color)
