"""What a mesh file holds: its parts with their looks, its materials, and what could not be shown.

Never reads a file and never joins parts.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError

ALLOW = "pass --allow_untextured (in Python allow_untextured=True) to go on without it"


@dataclass
class MeshPart:
    """Triangles of one material. Without `texture`, `colors` and `color` the file says nothing.

    `texture` (with `uv`, v up) and `colors` together mean their product in linear light; `color`
    is used where there is neither.
    """

    vertices: NDArray[np.float64]  # (V, 3)
    faces: NDArray[np.int64]  # (F, 3)
    uv: NDArray[np.float32] | None = None  # (V, 2)
    texture: NDArray[np.uint8] | None = None  # (H, W, 3) sRGB
    colors: NDArray[np.uint8] | None = None  # (V, 3) sRGB
    color: NDArray[np.uint8] | None = None  # (3,) sRGB
    wrap: tuple[str, str] = ("repeat", "repeat")  # or "clamp", "mirror"; along u and v


@dataclass(frozen=True)
class FileMaterial:
    """A material by name: the picture that it shows and its size, or its plain colour."""

    name: str
    picture: str = ""
    size: tuple[int, int] = (0, 0)  # width and height of the picture, pixels
    color: tuple[int, ...] | None = None  # sRGB bytes


@dataclass
class MeshContent:
    """All that was understood of a mesh file.

    `allow_untextured` lets looks be lost, `allow_flat` lets the file mean one flat colour. `named`
    lists what the file says about its looks (materials, pictures, colours), `warnings`
    what could not be shown and was allowed; `unit` is what one unit of the file's numbers means by
    the file itself, metres, where it says so.
    """

    path: Path
    allow_untextured: bool = False
    allow_flat: bool = False
    parts: list[MeshPart] = field(default_factory=list)
    materials: list[FileMaterial] = field(default_factory=list)
    named: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)  # for `doctor`: harmless, but good to know
    unit: float | None = None

    def name(self, what: str) -> None:
        """Take note of something that the file says about its looks, once."""
        if what not in self.named:
            self.named.append(what)

    def lost(self, what: str, remedy: str) -> None:
        """A part of the looks cannot be shown: an `InputError`, or a warning where allowed."""
        if not self.allow_untextured:
            advice = "" if self.allow_flat else f", or {ALLOW}"  # who reads data sets cannot
            raise InputError(f"{self.path}: {what}; {remedy}{advice}.")
        if what not in self.warnings:
            self.warnings.append(what)

    def other_unit(self, metres: float) -> str | None:
        """What to warn of where one unit of the file's numbers is taken as so many metres."""
        if self.unit is None or abs(metres - self.unit) <= 0.01 * metres:
            return None
        return f"by the file one unit is {self.unit:g} m, but the unit given is {metres:g} m"
