"""A journal beside a result file: what was done is on disk before the whole file is written.

Never holds the result itself; a finished run removes it.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from contextlib import suppress
from io import FileIO
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from ..io import check_writable, file_digest, read_text, replacing, write_all
from .messages import note

if TYPE_CHECKING:
    from ..datasets.bop import Estimate
    from ..geometry.pose import Pose

# The files that decide about poses beside the images: another one may have come to the same place.
FILES = ("mesh", "camera", "start", "mask", "points")
CONTENT = "_sha256"  # ends the name of a fact that is a file's content
MISSING = object()


class Journal:
    """Lines of JSON beside `output`, flushed one by one; the first says what the run goes by.

    Use as a context manager. With `resume` the entries of an interrupted run are kept; `InputError`
    if that went by other facts. Without an entry nothing is written, and an older journal stays.
    """

    def __init__(self, output: Path, facts: Mapping[str, Any], resume: bool) -> None:
        self.path = journal_file(output)
        self.facts = json.loads(json.dumps(facts))
        self.resume = resume
        self.entries: list[Any] = self._earlier() if resume else []
        self._file: FileIO | None = None

    def __enter__(self) -> Journal:
        check_writable(self.path)
        if not self.resume and self.path.is_file() and self.path.read_bytes().count(b"\n") > 1:
            note(
                f"{self.path} is of a run that was interrupted: --resume goes on with it, this "
                "run takes its place."
            )
        return self

    def add(self, content: Any) -> None:
        """Note one thing that was done."""
        try:
            if self._file is None:
                with replacing(self.path) as temporary:
                    self._file = temporary.open("wb", buffering=0)
                    for one in (self.facts, *self.entries, content):
                        write_all(self._file, _line(one))
            else:
                write_all(self._file, _line(content))
        except OSError as error:
            reason = error.strerror or error
            raise InputError(f"{self.path} cannot be written: {reason}.") from error

    def finish(self) -> None:
        """The result is written whole: nothing is left to go on with."""
        self.path.unlink(missing_ok=True)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._file is not None:
            with suppress(OSError):
                self._file.close()

    def _earlier(self) -> list[Any]:
        if not self.path.is_file():
            return []
        facts, entries = read_journal(self.path)
        other = other_fact(facts, self.facts)
        if other is not None:
            raise InputError(
                f"{self.path} belongs to a run with another {other}; give the arguments that it "
                "was begun with, or delete it."
            )
        return entries


def file_facts(args: argparse.Namespace) -> dict[str, Any]:
    """SHA-256 of the files of the options in `FILES`, as journals and summaries hold them.

    None where there is no file; of a mesh with the pictures and materials that it names.
    """
    from ..geometry.mesh_files.digest import mesh_digest

    found: dict[str, Any] = {}
    for name in FILES:
        digest = mesh_digest if name == "mesh" else file_digest
        given = getattr(args, name, None)
        if isinstance(given, list):
            found[f"{name}{CONTENT}"] = [path and digest(path) for path in given]
        else:
            found[f"{name}{CONTENT}"] = digest(given) if isinstance(given, Path) else None
    return found


def other_fact(before: Mapping[str, Any], now: Mapping[str, Any]) -> str | None:
    """What one run goes by and another does not; None if they go by the same.

    A file goes by its content and may have come to another place; where the record of an earlier
    version does not tell that, by its place.
    """
    for name, value in now.items():
        known = f"{name}{CONTENT}" in before or (name.endswith(CONTENT) and name not in before)
        if not known and before.get(name, MISSING) != value:
            return name.removesuffix(CONTENT)
    return None


def journal_file(output: Path) -> Path:
    """Where the journal of a result file lies."""
    return output.with_name(f"{output.name}.unfinished")


def read_journal(path: Path) -> tuple[dict[str, Any], list[Any]]:
    """What a journal's run goes by, and its entries; `InputError` if it is damaged."""
    text = read_text(path)
    lines = text[: text.rfind("\n") + 1].splitlines()  # the last may not have been finished
    try:
        facts, *entries = [json.loads(line) for line in lines]
        if not isinstance(facts, dict):
            raise ValueError("its first line is no object")
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path} is damaged; delete it and begin anew.") from error
    return facts, entries


def _line(content: Any) -> bytes:
    return json.dumps(content).encode() + b"\n"


def pose_line(pose: Pose) -> dict[str, Any]:
    """What a journal keeps of a pose, exactly."""
    return {"rotation": pose.rotation.tolist(), "translation": pose.translation.tolist()}


def pose_of(line: Mapping[str, Any]) -> Pose:
    """The pose of a journal's line."""
    import torch

    from ..geometry.pose import Pose

    turn, shift = (
        torch.tensor(line[key], dtype=torch.float64) for key in ("rotation", "translation")
    )
    return Pose(turn, shift)


_NUMBERS = ("scene", "image", "object", "score", "seconds")


def estimate_line(estimate: Estimate) -> dict[str, Any]:
    """What a journal keeps of a line of a BOP result file, exactly."""
    return {**{name: getattr(estimate, name) for name in _NUMBERS}, **pose_line(estimate.pose)}


def estimate_of(line: Mapping[str, Any]) -> Estimate:
    """The estimate of a journal's line."""
    from ..datasets.bop import Estimate

    return Estimate(**{name: line[name] for name in _NUMBERS}, pose=pose_of(line))
