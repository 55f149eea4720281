"""The names of a folder's images: their order, and which of them are one video.

Never opens a file.
"""

from __future__ import annotations

import glob
import re
from collections.abc import Iterable, Sequence
from fnmatch import fnmatchcase, translate
from pathlib import Path

# A time in seconds with whatever is around it, and the place of a number as printf writes it.
_STAMP = re.compile(r"(.*?)(\d+)(?:\.(\d*))?(\D*)")
_PRINTF = re.compile(r"%0?(\d{0,2})d")
# Fewer pictures are no series; two series share this much of their numbers.
SHORTEST_SERIES, SHARED = 3, 0.9


def natural_order(path: Path) -> list[tuple[int, str]]:
    """Sort key for names: runs of digits compare as numbers."""
    parts = re.split(r"(\d+)", path.name)
    return [(int(part), part) if part.isdecimal() else (-1, part) for part in parts]


def in_order(paths: Iterable[Path]) -> list[Path]:
    """In the order of their names, numbers compared as numbers, times as decimals.

    Times are told by fractions of different lengths: who writes 0.1 for 0.100 never ends one with
    a zero, who counts 1.9, 1.10 does.

    >>> [path.stem for path in in_order(map(Path, ["4.33.png", "4.066.png", "4.033.png"]))]
    ['4.033', '4.066', '4.33']
    """
    ordered = sorted(paths, key=natural_order)
    stamps = [stamp for path in ordered if (stamp := _STAMP.fullmatch(path.stem)) is not None]
    fractions = {stamp[3] or "" for stamp in stamps}
    if (
        len(stamps) == len(ordered)
        and len({(stamp[1], stamp[4]) for stamp in stamps}) == 1
        and len(set(map(len, fractions))) > 1
        and not any(len(fraction) > 1 and fraction.endswith("0") for fraction in fractions)
    ):
        times = [(int(stamp[2]), stamp[3] or "") for stamp in stamps]
        return [path for _, path in sorted(zip(times, ordered, strict=True))]
    return ordered


def is_pattern(name: str) -> bool:
    """Whether a name stands for several: `*-color.png`, or `%06d.jpg` as printf has it."""
    return bool(re.search(r"[*?\[]", name) or _PRINTF.search(name))


def fits(name: str, pattern: str) -> bool:
    """Whether a name is one of those that a pattern stands for.

    >>> fits("000012-color.png", "*-color.png"), fits("12.jpg", "%06d.jpg")
    (True, False)
    """
    form = translate(_PRINTF.sub("\0", pattern))
    for width in _PRINTF.findall(pattern):
        form = form.replace("\0", f"[0-9]{{{int(width or 1)},}}", 1)
    return re.match(form, name) is not None


def series(names: Sequence[str]) -> list[str]:
    """Patterns of the series, the same numbers each with another rest, that names fall into.

    Empty where they are a single one, or nothing of the kind.

    >>> series([f"{number}-{what}.png" for what in ("color", "depth") for number in range(3)])
    ['*-color.png', '*-depth.png']
    """
    groups: dict[str, list[list[str]]] = {}
    for name in names:
        parts = re.split(r"(\d+)", name)
        groups.setdefault("0".join(parts[::2]).lower(), []).append(parts)
    known = {text: _numbers(group) for text, group in groups.items()}
    longest = max(known.values(), key=len, default=set())
    alike = [
        groups[text]
        for text, numbers in known.items()
        if len(numbers) >= SHORTEST_SERIES
        and len(numbers & longest) >= SHARED * len(numbers | longest)
    ]
    return [_pattern(group, names) for group in alike] if len(alike) > 1 else []


def _numbers(group: Sequence[Sequence[str]]) -> set[int]:
    """The numbers at that place of the names where there are most different ones."""
    places = [set(map(int, place)) for place in zip(*(parts[1::2] for parts in group), strict=True)]
    return max(places, key=len, default=set())


def _pattern(group: Sequence[Sequence[str]], names: Sequence[str]) -> str:
    """A pattern of these names and no others: a glob pattern, or printf's where that is more."""
    found = {"*": "", "%": ""}
    for place in zip(*group, strict=True):
        widths = set(map(len, place))
        number = f"%0{min(widths)}d" if len(widths) == 1 else "%d"
        for kind, varying in (("*", "*"), ("%", number)):
            found[kind] += varying if len(set(place)) > 1 else glob.escape(place[0])
    alone = sum(fnmatchcase(name, found["*"]) for name in names) == len(group)
    return found["*"] if alone else found["%"]
