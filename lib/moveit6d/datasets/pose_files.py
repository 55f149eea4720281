"""Reads and writes the small files of a track: camera.json, pose.json and poses.csv.

Never opens images or meshes. Poses in files are object → camera, OpenCV axes, metres, in the frame
of the mesh file.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, TextIO

from ..errors import InputError
from ..geometry.camera import Camera
from ..geometry.pose import Pose
from ..io import replacing, write_json

ROTATION_COLUMNS = tuple(f"r{row}{column}" for row in (1, 2, 3) for column in (1, 2, 3))
POSE_COLUMNS = (*ROTATION_COLUMNS, "tx", "ty", "tz")
TRACK_COLUMNS = (
    "frame", "image", *POSE_COLUMNS, "steps", "stopped_by", "confidence", "milliseconds",
)  # fmt: skip
# A benchmark's result: one such file a sequence.
RESULT_COLUMNS = ("frame", *POSE_COLUMNS, "milliseconds")


@dataclass(frozen=True)
class PoseRow:
    """One line of poses.csv. What a file does not tell is empty or None.

    `pose` is None for a frame without a pose; `object` names the object where a file holds
    several; `reset` says that the pose was set to the truth after this frame.
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


def read_camera(path: Path) -> Camera:
    """The camera of a file; see `Camera.load`."""
    return Camera.load(path)


def write_camera(path: Path, camera: Camera) -> None:
    """Write a camera.json that `read_camera` reads back exactly."""
    write_json(path, camera_content(camera))


def camera_content(camera: Camera) -> dict[str, Any]:
    """What a camera.json holds of a camera."""
    content: dict[str, Any] = {
        key: getattr(camera, key) for key in ("fx", "fy", "cx", "cy", "width", "height")
    }
    if camera.distortion is not None:
        content["distortion"] = list(camera.distortion)
    if camera.distortion_model != "opencv":
        content["distortion_model"] = camera.distortion_model
    if camera.skew:
        content["skew"] = camera.skew
    return content


class PoseWriter:
    """Writes poses.csv row by row under a temporary name; closing gives it its real name.

    Use as a context manager: whatever ends the block (the end of the video, Ctrl-C, an error), the
    rows written so far become the file; an error before the first row leaves none. Constant
    memory. `columns` chooses and orders the columns.
    """

    def __init__(self, path: Path, columns: Sequence[str] = TRACK_COLUMNS) -> None:
        self.path = path
        self.columns = tuple(columns)
        self._stack = replacing(path)
        self._file: TextIO | None = None
        self._rows = 0

    def __enter__(self) -> PoseWriter:
        temporary = self._stack.__enter__()
        try:
            self._file = temporary.open("w", encoding="utf-8", newline="")
        except OSError as error:
            self._stack.__exit__(type(error), error, error.__traceback__)
            raise
        self._file.write(",".join(self.columns) + "\n")
        return self

    def write(self, row: PoseRow) -> None:
        """Append one row."""
        assert self._file is not None, "use `with PoseWriter(...)`"
        csv.writer(self._file, lineterminator="\n").writerow(
            [_cell(row, column) for column in self.columns]
        )
        self._rows += 1

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        assert self._file is not None
        try:
            self._file.close()
        except OSError as full:
            self._stack.__exit__(type(full), full, full.__traceback__)
            raise
        if self._rows or kind is None:
            self._stack.__exit__(None, None, None)
        else:
            self._stack.__exit__(kind, error, trace)


def write_poses(
    path: Path, rows: Iterable[PoseRow], columns: Sequence[str] = TRACK_COLUMNS
) -> None:
    """Write a whole poses.csv, atomically."""
    with PoseWriter(path, columns) as writer:
        for row in rows:
            writer.write(row)


def read_poses(path: Path) -> list[PoseRow]:
    """All rows of a poses.csv in the order of the file; other columns are ignored.

    Needs the columns frame, r11 … r33, tx, ty, tz. A row whose pose is empty or not finite has no
    pose; one that is half filled, or no rotation, is an `InputError` that names its line.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.DictReader(file)
            missing = [c for c in ("frame", *POSE_COLUMNS) if c not in (reader.fieldnames or ())]
            if missing:
                raise InputError(
                    f"{path}: no column {', '.join(missing)}; its first line must name the "
                    "columns frame, r11 … r33, tx, ty, tz."
                )
            return [_read_row(row, f"{path}, line {reader.line_num}") for row in reader]
    except FileNotFoundError:
        raise InputError(f"{path} does not exist.") from None
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path} cannot be read: {error}.") from error


def by_frame(rows: Iterable[PoseRow], where: str) -> dict[int, PoseRow]:
    """Rows by frame number; `InputError` naming `where` if a frame occurs twice."""
    found: dict[int, PoseRow] = {}
    for row in rows:
        if row.frame in found:
            raise InputError(f"{where}: frame {row.frame} occurs twice.")
        found[row.frame] = row
    return found


def _read_row(row: Mapping[str, str | None], where: str) -> PoseRow:
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
    frame = _optional(row["frame"], f"{where}: frame")
    if frame is None or not frame.is_integer():
        raise InputError(f"{where}: frame must be a whole number, found {row['frame']!r}.")
    iterations = _optional(row.get("steps"), f"{where}: steps")
    return PoseRow(
        frame=int(frame),
        image=row.get("image") or "",
        pose=pose,
        iterations=None if iterations is None else int(iterations),
        stopped_by=row.get("stopped_by") or "",
        confidence=_optional(row.get("confidence"), f"{where}: confidence"),
        milliseconds=_optional(row.get("milliseconds"), f"{where}: milliseconds"),
        reset=bool(_optional(row.get("reset"), f"{where}: reset") or 0),
        object=row.get("object") or "",
    )


def _cell(row: PoseRow, column: str) -> str:
    if column in POSE_COLUMNS:
        if row.pose is None:
            return ""
        index = POSE_COLUMNS.index(column)
        flat = row.pose.rotation.reshape(9) if index < 9 else row.pose.translation
        return f"{float(flat[index % 9]):.10g}"
    value = row.iterations if column == "steps" else getattr(row, column)
    if value is None:
        return ""
    if isinstance(value, bool):
        return str(int(value))
    return f"{value:.4f}" if isinstance(value, float) else str(value)


def _optional(text: str | None, where: str) -> float | None:
    text = (text or "").strip()
    if not text:
        return None
    try:
        return float(text)
    except ValueError:
        raise InputError(f"{where} must be a number, found {text!r}.") from None
