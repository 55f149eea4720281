"""A journal beside a result file: what was done is on disk before the whole file is written.

Never holds the result itself; a finished run removes it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO

from ..errors import InputError
from ..io import read_text, replacing


class Journal:
    """Lines of JSON beside `output`, flushed one by one; the first says what the run goes by.

    Use as a context manager. With `resume` the entries of an interrupted run are kept; `InputError`
    if that went by other facts.
    """

    def __init__(self, output: Path, facts: Mapping[str, Any], resume: bool) -> None:
        self.path = output.with_name(f"{output.name}.unfinished")
        self.facts = json.loads(json.dumps(facts))
        self.entries: list[Any] = self._earlier() if resume else []
        self._file: BinaryIO | None = None

    def __enter__(self) -> Journal:
        with replacing(self.path) as temporary:
            self._file = temporary.open("wb", buffering=0)
            for content in (self.facts, *self.entries):
                self._file.write(json.dumps(content).encode() + b"\n")
        return self

    def add(self, content: Any) -> None:
        """Note one thing that was done."""
        assert self._file is not None
        try:
            self._file.write(json.dumps(content).encode() + b"\n")
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
        text = read_text(self.path)
        lines = text[: text.rfind("\n") + 1].splitlines()  # the last may not have been finished
        try:
            facts, *entries = [json.loads(line) for line in lines]
        except ValueError as error:
            raise InputError(f"{self.path} is damaged; delete it and begin anew.") from error
        other = [key for key, value in self.facts.items() if facts.get(key) != value]
        if other:
            raise InputError(
                f"{self.path} belongs to a run with another {other[0]}; give the arguments that it "
                "was begun with, or delete it."
            )
        return entries
