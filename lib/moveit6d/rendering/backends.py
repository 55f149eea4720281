"""The renderers by name.

Never imports a back end before it is asked for.
"""

from __future__ import annotations

from importlib import import_module

from ..errors import InputError, RenderingUnavailable
from .renderer import Renderer

# Module and class of each back end.
BACKENDS = {
    "embree": ("embree", "EmbreeRenderer"),  # casts rays on the CPU, runs everywhere
    "pyrender": ("pyrender_backend", "PyrenderRenderer"),  # OpenGL
}
NAMES = tuple(BACKENDS)


def make_renderer(name: str = "embree") -> Renderer:
    """The back end of that name; `RenderingUnavailable` says what it lacks on this machine."""
    if name not in BACKENDS:
        raise InputError(f"There is no renderer {name!r}; choose one of {', '.join(NAMES)}.")
    module, kind = BACKENDS[name]
    renderer: Renderer = getattr(import_module(f".{module}", __package__), kind)()
    return renderer


def available_renderers() -> dict[str, str | None]:
    """For each back end why it cannot run on this machine, or None where it can."""
    reasons: dict[str, str | None] = {}
    for name in NAMES:
        try:
            make_renderer(name)
            reasons[name] = None
        except RenderingUnavailable as error:
            reasons[name] = str(error)
    return reasons
