"""What an earlier run left in the folder of results: told, and removed where nothing replaces it.

Never touches a file that an earlier run of this program did not write.
"""

from __future__ import annotations

import glob
import json
from collections.abc import Iterable
from pathlib import Path

from .messages import note


def clear_earlier(folder: Path, written: Iterable[Path | None]) -> None:
    """Remove an earlier track's files from a folder, but those that this run writes anew.

    A track is known by its summary.json, which also names its report and its file for rerun; it is
    removed, too, until this run ends.
    """
    summary = folder / "summary.json"
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
    try:
        given = json.loads(summary.read_text(encoding="utf-8"))["arguments"]
        named = [given.get("report"), given.get("rerun")]
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        named = []
    inside = [
        path
        for path in (Path(name) for name in named if isinstance(name, str))
        if path.suffix in (".html", ".rrd") and path.resolve().parent == folder.resolve()
    ]
    logs = [path for path in inside if path.suffix == ".rrd"]
    bases = [folder / "overlay.mp4", *logs]
    later = [path for base in bases for path in _numbered(base)]
    return [path for path in (bases[0], *later, *inside) if path.is_file()]


def _numbered(path: Path) -> list[Path]:
    """The files of that name with the numbers of frames, of tracks that were gone on with."""
    beside = sorted(path.parent.glob(f"{glob.escape(path.stem)}_*{path.suffix}"))
    return [one for one in beside if one.stem[len(path.stem) + 1 :].isdecimal()]
