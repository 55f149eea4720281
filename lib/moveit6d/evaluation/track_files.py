"""Finds the tracks of sequences among results: which file, which object, and which frames.

Never scores and never tracks.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from collections.abc import Sequence as List
from pathlib import Path

from ..datasets.pose_files import PoseRow, by_frame, read_poses
from ..datasets.sequences import Sequence, placed
from ..errors import InputError

Track = dict[int, PoseRow]  # by frame of the sequence


def read_tracks(
    sequences: Iterable[Sequence], path: str | Path
) -> Iterator[tuple[Sequence, Track]]:
    """Each sequence that the results at `path` hold a track of, with its rows by frame.

    `path` is a folder of <sequence>.csv or <sequence>/poses.csv; for sequences of one video also a
    file, or a folder with a poses.csv. A file with a column `object` holds the tracks of several
    sequences, `clip.cup` and `clip.plate`, and may be called by the video alone. Rows that name
    images belong to those, whatever their numbers.
    """
    path, listed = Path(path), list(sequences)
    if not path.exists():
        raise InputError(f"{path} does not exist; it should hold results to score.")
    one_video = len({(one.folder, one.frames, one.images) for one in listed}) == 1
    if path.is_file() and not one_video:
        raise InputError(f"{path} is one track, but there are {len(listed)} sequences.")
    for sequence in listed:
        own, shared = _places(path, sequence, one_video)
        for place in (*own, *shared):
            if place.is_file():
                rows = _rows(place, sequence, listed, place in shared and len(listed) > 1)
                if rows is not None:
                    names = sequence.image_names
                    yield sequence, by_frame(placed(rows, names, str(place)), str(place))
                break


def _places(path: Path, sequence: Sequence, one_video: bool) -> tuple[List[Path], List[Path]]:
    """Where a sequence's track may be, in this order: files of its own, and those of its video."""
    if path.is_file():
        return [], [path]
    name, label = sequence.name, f".{sequence.object}"
    own = [path / f"{name}.csv", path / name / "poses.csv"]
    video = name.removesuffix(label)
    shared = [path / f"{video}.csv", path / video / "poses.csv"] if video != name else []
    return own, [*shared, *[path / "poses.csv"] * one_video]


def _rows(
    file: Path, sequence: Sequence, listed: List[Sequence], is_shared: bool
) -> list[PoseRow] | None:
    """The rows of a sequence's object in a file, in its order; None where only others' are."""
    by_object = {one.object: one for one in listed if one.folder == sequence.folder}
    rows = read_poses(file, center=lambda label: by_object.get(label, sequence).load_mesh().center)
    labels = list(dict.fromkeys(row.object for row in rows))
    if sequence.object in labels:
        return [row for row in rows if row.object == sequence.object]
    if is_shared and (not labels or by_object.keys() & labels):
        return None
    if is_shared and "" in labels:
        raise InputError(
            f"{file} does not say of which object it is: name it in a column object, as "
            f"{sequence.object}, or call the file {sequence.name}.csv."
        )
    if is_shared:
        raise InputError(
            f"{file} holds tracks of {', '.join(labels)}; in its column object the objects must be "
            f"called {' and '.join(by_object)}."
        )
    if len(labels) > 1:
        raise InputError(
            f"{file} holds tracks of {', '.join(labels)}, but {sequence.name} is of one object; "
            "keep the rows of that one."
        )
    return rows
