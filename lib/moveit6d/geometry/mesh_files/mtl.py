"""Material libraries (MTL) of OBJ files, as exporters and people write them.

Never opens pictures; `obj` does. Format: Wavefront, "Object Files", appendix B2.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from .beside import decoded, read_bytes

# Options of a picture and how many values follow: at least, at most.
OPTIONS = {
    "-blendu": (1, 1), "-blendv": (1, 1), "-cc": (1, 1), "-clamp": (1, 1), "-imfchan": (1, 1),
    "-texres": (1, 1), "-boost": (1, 1), "-bm": (1, 1), "-mm": (2, 2), "-type": (1, 1),
    "-o": (1, 3), "-s": (1, 3), "-t": (1, 3),
}  # fmt: skip
NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
# What shows the surface's own colour, the most telling first.
PICTURES = ("map_kd", "map_basecolor", "map_ka", "map_ke")


@dataclass
class Map:
    """A picture of a material: its name as written, and how it lies on the surface."""

    name: str
    scale: tuple[float, float] = (1.0, 1.0)
    offset: tuple[float, float] = (0.0, 0.0)
    clamp: bool = False
    base: float = 0.0  # of -mm: colour = base + gain · picture
    gain: float = 1.0


@dataclass
class MtlMaterial:
    """One `newmtl`: its picture, its mask and its plain colour (sRGB, 0 to 1)."""

    name: str
    library: Path
    picture: Map | None = None
    mask: Map | None = None
    color: tuple[float, float, float] | None = None
    unread: str = ""  # the line of its plain colour, if that is not understood


def read_mtl(path: Path) -> dict[str, MtlMaterial]:
    """The materials of a library by name."""
    found: dict[str, MtlMaterial] = {}
    maps: dict[str, Map] = {}
    current = MtlMaterial("", path)
    text = decoded(read_bytes(path)).replace("\\\r\n", " ").replace("\\\n", " ")
    for line in text.splitlines():
        keyword, rest = [*line.strip().split(None, 1), "", ""][:2]
        keyword = keyword.lower()
        if keyword == "newmtl":
            current, maps = MtlMaterial(rest, path), {}
            found.setdefault(rest, current)
        elif keyword == "kd":
            current.color = _color(rest)
            current.unread = line.strip() if current.color is None else ""
        elif keyword in PICTURES and rest:
            maps[keyword] = read_map(rest)
            current.picture = next(maps[key] for key in PICTURES if key in maps)
        elif keyword == "map_d" and rest:
            current.mask = read_map(rest)
    return found


def read_map(text: str) -> Map:
    """A picture's options and its name, which may hold blanks, from the rest of its line."""
    result = Map("")
    tokens = list(re.finditer(r"\S+", text))
    k = 0
    while k < len(tokens) and tokens[k].group().lower() in OPTIONS:
        option = tokens[k].group().lower()
        least, most = OPTIONS[option]
        values: list[str] = []
        for token in tokens[k + 1 : k + 1 + most]:
            if len(values) >= least and not NUMBER.fullmatch(token.group()):
                break
            values.append(token.group())
        if k + 1 + len(values) >= len(tokens):  # the name itself is never an option's value
            values = values[:-1]
        _apply(result, option, values)
        k += 1 + len(values)
    result.name = text[tokens[k].start() :].strip() if k < len(tokens) else ""
    return result


def _apply(result: Map, option: str, values: list[str]) -> None:
    numbers = [float(value) for value in values if NUMBER.fullmatch(value)]
    if option == "-clamp":
        result.clamp = values[:1] == ["on"]
    elif option == "-s" and numbers:
        result.scale = (numbers[0], numbers[1] if len(numbers) > 1 else 1.0)
    elif option == "-o" and numbers:
        result.offset = (numbers[0], numbers[1] if len(numbers) > 1 else 0.0)
    elif option == "-mm" and len(numbers) == 2:
        result.base, result.gain = numbers


def _color(text: str) -> tuple[float, float, float] | None:
    """Red, green and blue; None for `xyz`, `spectral` and whatever is no plain number."""
    words = text.partition("#")[0].split()
    if len(words) == 1:  # green and blue equal red where they are not given
        words *= 3
    if len(words) < 3 or not all(NUMBER.fullmatch(word) for word in words[:3]):
        return None
    return float(words[0]), float(words[1]), float(words[2])
