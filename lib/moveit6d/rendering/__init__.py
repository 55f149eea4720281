"""Renderers: from a mesh, a pose and intrinsics to albedo, normal, depth and mask.

Never imports a back end before it is asked for, and never lights a scene beyond one plain lamp.
"""

from .backends import available_renderers, make_renderer
from .renderer import GBuffer, Renderer
from .shading import shade_plain

__all__ = ["GBuffer", "Renderer", "available_renderers", "make_renderer", "shade_plain"]
