"""What an earlier run left in the folder of results: told, and removed where nothing replaces it.

Never touches a file that an earlier run of this program did not write.
"""

from __future__ import annotations

import glob
import json
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from .journal import journal_file
from .messages import note

PICTURE, START_PICTURE = "start.png", "start_picture"  # the file, and who names it in summaries
TABLE, SUMMARY, DETECTION = "poses.csv", "summary.json", "detection.json"
OF_DETECTION = re.compile(
    r"poses\.csv|detection\.json|pose(_[^/]+)?\.json|overlay\.png|overlay/[^/]+\.png"
)


def holds_results(folder: Path) -> bool:
    """Whether a track or a detection left its results in a folder, whole or not."""
    if journal_file(folder / TABLE).is_file():
        return True
    return any("arguments" in _content(folder / name) for name in (SUMMARY, DETECTION))


def clear_detection(folder: Path) -> None:
    """Remove the files of an earlier detection from a folder: those that its detection.json names.

    A pose that was put beside them stays.
    """
    names = _content(folder / DETECTION).get("files")
    for name in names if isinstance(names, list) else ():
        if isinstance(name, str) and OF_DETECTION.fullmatch(name):
            (folder / name).unlink(missing_ok=True)


def clear_earlier(folder: Path, written: Iterable[Path | None]) -> None:
    """Remove an earlier track's files from a folder, but those that this run writes anew.

    A track is known by its summary.json, which also names its report and its file for rerun; it is
    removed, too, until this run ends, and so is what an interrupted run could be gone on with.
    """
    journal_file(folder / TABLE).unlink(missing_ok=True)
    summary = folder / SUMMARY
    if not summary.is_file():
        return
    new = {path.resolve() for path in written if path is not None}
    stale = [path for path in _files(folder, summary) if path.resolve() not in new]
    for path in (*stale, summary):  # an older summary must not vouch for half of a new track
        path.unlink(missing_ok=True)
    gone = f"; removed: {', '.join(path.name for path in stale)}" if stale else ""
    note(f"{folder} holds an earlier track, which is replaced{gone}.")


def _files(folder: Path, summary: Path) -> list[Path]:
    """The earlier track's files in the folder that a new one need not have."""
    content = _content(summary)
    given, objects = content.get("arguments"), content.get("objects")
    named = [given.get(name) for name in ("report", "rerun")] if isinstance(given, dict) else []
    files = [Path(name) for name in named if isinstance(name, str)]
    if isinstance(objects, dict):  # each has its own
        files = [p.parent / f"{p.stem}_{name}{p.suffix}" for p in files for name in objects]
    inside = [
        path
        for path in files
        if path.suffix in (".html", ".rrd") and path.resolve().parent == folder.resolve()
    ]
    inside += [folder / PICTURE] if content.get(START_PICTURE) == PICTURE else []
    logs = [path for path in inside if path.suffix == ".rrd"]
    bases = [folder / "overlay.mp4", *logs]
    later = [path for base in bases for path in _numbered(base)]
    return [path for path in (bases[0], *later, *inside) if path.is_file()]


def _content(path: Path) -> dict[str, Any]:
    """What a file of results says; nothing if it is another program's."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}


def _numbered(path: Path) -> list[Path]:
    """The files of that name with the numbers of frames, of tracks that were gone on with."""
    beside = sorted(path.parent.glob(f"{glob.escape(path.stem)}_*{path.suffix}"))
    return [one for one in beside if one.stem[len(path.stem) + 1 :].isdecimal()]
