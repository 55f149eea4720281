"""What a command says while it runs: notes, details and progress, on stderr, as much as is wanted.

Never prints results; those go to stdout.
"""

from __future__ import annotations

import argparse
import logging
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import Any, TextIO, TypeVar

Item = TypeVar("Item")

BAD_USAGE = 2
QUIET, NORMAL, VERBOSE = 0, 1, 2
STEP = 0.1  # of the whole, from line to line of progress
SOONEST, LATEST = 2.0, 30.0  # seconds between two lines of progress

QUIETLY, VERBOSELY = ("-q", "--quiet"), ("-v", "--verbose")

_level = NORMAL


def add_message_options(parser: argparse.ArgumentParser) -> None:
    """-q and -v."""
    group = parser.add_argument_group("messages").add_mutually_exclusive_group()
    # No defaults: of `evaluate -q bop` the inner verb's would undo what was said before it.
    none = argparse.SUPPRESS
    group.add_argument(*QUIETLY, action="store_true", default=none, help="errors only")
    group.add_argument(
        *VERBOSELY,
        action="store_true",
        default=none,
        help="also what was read, and where errors arose",
    )


def set_level(quiet: bool, verbose: bool) -> None:
    """How much this process says from now on."""
    global _level
    _level = QUIET if quiet else VERBOSE if verbose else NORMAL


def get_level() -> int:
    """How much this process says."""
    return _level


def is_verbose() -> bool:
    """Whether details are wanted."""
    return _level == VERBOSE


def note(text: str) -> None:
    """A line on stderr that does not tear a progress bar; none if only errors are wanted."""
    if _level > QUIET:
        from tqdm import tqdm

        tqdm.write(f"moveit6d: {text}", file=sys.stderr)


def detail(text: str) -> None:
    """A line on stderr for who asked for details."""
    if _level == VERBOSE:
        note(text)


@contextmanager
def warnings_as_notes() -> Iterator[None]:
    """What the library warns of, as notes."""
    handler, log = _Notes(), logging.getLogger("moveit6d")
    log.addHandler(handler)
    try:
        yield
    finally:
        log.removeHandler(handler)


class _Notes(logging.Handler):
    def emit(self, record: logging.LogRecord) -> None:
        note(record.getMessage())


def progress(
    items: Iterable[Item], total: int | None, what: str, unit: str = "frame"
) -> Iterator[Item]:
    """The items, while stderr says how far they are."""
    with progress_bar(total, what, unit) as bar:
        for item in items:
            yield item
            bar.update()


def progress_bar(total: int | None, what: str, unit: str = "frame") -> Any:
    """A bar on a terminal, a line every tenth or half minute elsewhere; moved on by `update()`."""
    if _level == QUIET:
        return ProgressLines(total, what, unit, lambda text: None)
    if not _is_terminal(sys.stderr):
        return ProgressLines(total, what, unit, note)
    from tqdm import tqdm

    return tqdm(total=total, desc=what, unit=unit, file=sys.stderr, leave=False)


class ProgressLines:
    """Progress for log files and pipes: few lines, each complete in itself."""

    def __init__(
        self,
        total: int | None,
        what: str,
        unit: str,
        say: Callable[[str], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.total, self.what, self.unit, self.say, self.clock = total, what, unit, say, clock
        self.done = 0
        self._begin = self._last = clock()
        self._said = 0

    def __enter__(self) -> ProgressLines:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def update(self, count: int = 1) -> None:
        """Take note that more items are done."""
        self.done += count
        now = self.clock()
        since = now - self._last
        enough = self.total is not None and self.done - self._said >= STEP * self.total
        if (enough and since >= SOONEST) or since >= LATEST:
            self._last, self._said = now, self.done
            self.say(self._line(now - self._begin))

    def close(self) -> None:
        """Nothing more comes."""

    def _line(self, seconds: float) -> str:
        each = seconds / max(self.done, 1)
        pace = f"{1e3 * each:.0f} ms" if each < 1 else f"{each:.1f} s"
        if not self.total:
            return f"{self.what}: {self.done} {self.unit}s, {pace} each"
        left = max(self.total - self.done, 0) * each
        share = f"{100 * self.done / self.total:.0f} %"
        return (
            f"{self.what}: {self.done} of {self.total} {self.unit}s ({share}), {pace} each, "
            f"{int(left) // 60}:{int(left) % 60:02d} left"
        )


def _is_terminal(stream: TextIO | None) -> bool:
    return stream is not None and stream.isatty()
