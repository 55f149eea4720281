"""Reads and writes the small files of a track: camera.json, pose.json and poses.csv.

Never opens images or meshes. Poses in files are object → camera, OpenCV axes, metres, in the frame
of the mesh file.
"""

from __future__ import annotations

import csv
import io
import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import TracebackType
from typing import Any

from ..checks import number, whole
from ..errors import InputError
from ..geometry.camera import Camera
from ..geometry.camera_files import camera_content as camera_content
from ..geometry.pose import FARTHEST, Pose, in_metres
from ..io import check_writable, read_text, replacing, write_all

ROTATION_COLUMNS = tuple(f"r{row}{column}" for row in (1, 2, 3) for column in (1, 2, 3))
POSE_COLUMNS = (*ROTATION_COLUMNS, "tx", "ty", "tz")
TRACK_COLUMNS = (
    "frame", "image", *POSE_COLUMNS, "iterations", "stopped_by", "confidence", "probability",
    "milliseconds", "state",
)  # fmt: skip
FORMER = {"steps": "iterations"}  # columns as tables of earlier versions call them
# A benchmark's result: one such file a sequence.
RESULT_COLUMNS = ("frame", *POSE_COLUMNS, "milliseconds")


@dataclass(frozen=True)
class PoseRow:
    """One line of poses.csv. What a file does not tell is empty or None.

    `pose` is None for a frame without a pose; `object` names the object where a file holds
    several; `reset` says that the pose was set to the truth after this frame; `state` is the
    tracker's: tracking, uncertain or lost. `confidence` is the network's own in tracks,
    `probability` that the pose is right (`TrackingResult`).
    """

    frame: int
    image: str = ""
    pose: Pose | None = None
    iterations: int | None = None
    stopped_by: str = ""
    confidence: float | None = None
    milliseconds: float | None = None
    reset: bool = False
    object: str = ""
    state: str = ""
    probability: float | None = None


def track_columns(objects: int) -> tuple[str, ...]:
    """Columns of poses.csv; of several objects with their names before the state."""
    if objects == 1:
        return TRACK_COLUMNS
    return (*TRACK_COLUMNS[:-1], "object", TRACK_COLUMNS[-1])


def read_camera(path: str | Path) -> Camera:
    """The camera of a file; see `Camera.load`."""
    return Camera.load(path)


def write_camera(path: str | Path, camera: Camera) -> None:
    """Write a camera.json; see `Camera.save`."""
    camera.save(path)


class PoseWriter:
    """Writes poses.csv row by row; every row can be read as soon as it is written.

    Use as a context manager. The first row takes the place of an older file; from then on whatever
    ends the program (the end of the video, a signal, a full disk, `kill -9`) leaves whole rows. No
    row, no change. `resume` goes on behind the whole rows of a file that is there, with its
    columns: an earlier version wrote fewer. Constant memory. `columns` chooses and orders the
    columns.
    """

    def __init__(
        self, path: str | Path, columns: Sequence[str] = TRACK_COLUMNS, resume: bool = False
    ) -> None:
        self.path = Path(path)
        self.columns = tuple(columns)
        self.resume = resume
        self._file: io.FileIO | None = None
        self._end = 0  # of the last whole row, bytes

    def __enter__(self) -> PoseWriter:
        check_writable(self.path)
        if self.resume and self.path.is_file():
            self._go_on(self.path.read_bytes())
        return self

    def _go_on(self, content: bytes) -> None:
        """Open the file behind its whole rows; `InputError` if its header is no table's.

        Without a whole header it is begun anew.
        """
        self._end = content.rfind(b"\n") + 1
        if self._end == 0:
            return
        first = content[: content.find(b"\n")].decode("utf-8-sig", errors="replace")
        self.columns = _present_names(column.strip() for column in first.split(","))
        missing = [column for column in ("frame", *POSE_COLUMNS) if column not in self.columns]
        if missing:
            raise InputError(
                f"{self.path}: its header has no column {', '.join(missing)}; leave out --resume "
                "to begin anew, or give another --output."
            )
        self._file = self.path.open("r+b", buffering=0)
        self._file.truncate(self._end)
        self._file.seek(self._end)

    def write(self, row: PoseRow) -> None:
        """Append one row."""
        line = _line([_cell(row, column) for column in self.columns])
        try:
            if self._file is None:
                line = _line(self.columns) + line
                with replacing(self.path) as temporary:
                    self._file = temporary.open("wb", buffering=0)
                    write_all(self._file, line)
            else:
                write_all(self._file, line)
        except OSError as error:
            self._cut()
            raise InputError(
                f"{self.path} cannot be written: {error.strerror or error}; the rows before are "
                "kept."
            ) from error
        self._end += len(line)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._file is not None:
            with suppress(OSError):
                self._file.close()

    def _cut(self) -> None:
        """Take back what a full disk let through of a row."""
        if self._file is not None and self._end:
            with suppress(OSError):
                os.ftruncate(self._file.fileno(), self._end)


def write_poses(
    path: str | Path, rows: Iterable[PoseRow], columns: Sequence[str] | None = None
) -> None:
    """Write a whole poses.csv, atomically; without `columns` those of a track.

    That is with the column `object` where a row names one.

    Examples:
        >>> import torch
        >>> from moveit6d import Pose
        >>> pose = Pose(torch.eye(3), torch.tensor([0.0, 0.0, 0.5]))
        >>> write_poses("poses.csv", [PoseRow(0, "a.png", pose), PoseRow(1, "b.png")])
        >>> [row.pose is not None for row in read_poses("poses.csv")]
        [True, False]
    """
    rows = list(rows)
    if columns is None:
        columns = track_columns(1 + any(row.object for row in rows))
    with replacing(Path(path)) as temporary, temporary.open("wb") as file:
        file.write(_line(columns))
        for row in rows:
            file.write(_line([_cell(row, column) for column in columns]))


def _line(cells: Iterable[str]) -> bytes:
    """A line of CSV; names that are not UTF-8 are written with their bytes as numbers."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(list(cells))
    return text.getvalue().encode("utf-8", errors="backslashreplace")


def whole_lines(path: str | Path) -> str:
    """The text of a table without a last line that was not finished."""
    text = read_text(Path(path))
    return text[: text.rfind("\n") + 1]


def read_poses(
    path: str | Path, text: str | None = None, center: Any = (0.0, 0.0, 0.0)
) -> list[PoseRow]:
    """All rows of a poses.csv in the order of the file; other columns are ignored.

    Needs the columns frame, r11 … r33, tx, ty, tz. A row whose pose is empty or not finite has no
    pose; one that is half filled, no rotation or in millimetres is an `InputError` that names its
    line. `text` is the file's text if it was read already; `center` the object's middle in the mesh
    file's frame (`Mesh.center`), which matters where that is far from the origin, or a function
    that gives it for an object's name and is called for far poses only.
    """
    middle = cache(center) if callable(center) else lambda _: center
    lines = read_text(Path(path)) if text is None else text
    try:
        reader = csv.DictReader(io.StringIO(lines, newline=""), skipinitialspace=True)
        reader.fieldnames = columns = _present_names(reader.fieldnames or ())
        missing = [c for c in ("frame", *POSE_COLUMNS) if c not in columns]
        if missing:
            raise InputError(
                f"{path}: no column {', '.join(missing)}; its first line must name the "
                "columns frame, r11 … r33, tx, ty, tz."
            )
        return [_read_row(row, f"{path}, line {reader.line_num}", middle) for row in reader]
    except csv.Error as error:
        raise InputError(f"{path} cannot be read: {error}.") from error


def _present_names(columns: Iterable[str]) -> tuple[str, ...]:
    return tuple(FORMER.get(column, column) for column in columns)


def by_frame(rows: Iterable[PoseRow], where: str) -> dict[int, PoseRow]:
    """Rows by frame number; `InputError` naming `where` if a frame occurs twice."""
    found: dict[int, PoseRow] = {}
    for row in rows:
        if row.frame in found:
            raise InputError(f"{where}: frame {row.frame} occurs twice.")
        found[row.frame] = row
    return found


def _read_row(row: Mapping[str, str | None], where: str, center: Callable[[str], Any]) -> PoseRow:
    texts = [(row[column] or "").strip() for column in POSE_COLUMNS]
    pose = None
    if any(texts):
        named = zip(POSE_COLUMNS, texts, strict=True)
        values = [_optional(text, f"{where}: {column}") for column, text in named]
        if None in values:
            raise InputError(f"{where}: {POSE_COLUMNS[values.index(None)]} is empty.")
        numbers = [value for value in values if value is not None]
        if all(math.isfinite(value) for value in numbers):
            pose = Pose.checked(numbers[:9], numbers[9:], where=where)
            if float(pose.translation.norm()) > FARTHEST:  # reading a mesh takes long
                pose = in_metres(pose, where, center(row.get("object") or ""))
    frame = _optional(row["frame"], f"{where}: frame")
    if frame is None or not frame.is_integer() or abs(frame) > 2**53:
        raise InputError(f"{where}: frame must be a whole number, found {row['frame']!r}.")
    iterations = _optional(row.get("iterations"), f"{where}: iterations")
    return PoseRow(
        frame=int(frame),
        image=row.get("image") or "",
        pose=pose,
        iterations=None if iterations is None else whole(iterations, f"{where}: iterations"),
        stopped_by=row.get("stopped_by") or "",
        confidence=_finite(row.get("confidence"), f"{where}: confidence"),
        milliseconds=_finite(row.get("milliseconds"), f"{where}: milliseconds"),
        reset=bool(_optional(row.get("reset"), f"{where}: reset") or 0),
        object=row.get("object") or "",
        state=row.get("state") or "",
        probability=_finite(row.get("probability"), f"{where}: probability"),
    )


def _cell(row: PoseRow, column: str) -> str:
    if column in POSE_COLUMNS:
        if row.pose is None:
            return ""
        index = POSE_COLUMNS.index(column)
        flat = row.pose.rotation.reshape(9) if index < 9 else row.pose.translation
        return f"{float(flat[index % 9]):.10g}"
    value = getattr(row, column, None)  # a column that somebody added stays empty
    if value is None:
        return ""
    if isinstance(value, bool):
        return str(int(value))
    return f"{value:.4f}" if isinstance(value, float) else str(value)


def _finite(text: str | None, where: str) -> float | None:
    value = _optional(text, where)
    return None if value is None else number(value, where)


def _optional(text: str | None, where: str) -> float | None:
    text = (text or "").strip()
    if not text:
        return None
    try:
        return float(text)
    except ValueError:
        raise InputError(f"{where} must be a number, found {text!r}.") from None
