"""Ends of a run from outside: what Ctrl-C, `kill`, a closed terminal and a container's stop mean.

Never decides what is kept; verbs keep what was done when `KeyboardInterrupt` passes through them.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

# Those that ask a program to end (not SIGKILL, which nothing can answer).
ENDINGS = tuple(getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name))


class Terminated(KeyboardInterrupt):
    """The process was asked to end; `code` is the exit code that shells expect then."""

    def __init__(self, number: int) -> None:
        super().__init__(signal.Signals(number).name)
        self.code = 128 + number


@contextmanager
def ending_like_ctrl_c() -> Iterator[None]:
    """Treat SIGTERM and SIGHUP as Ctrl-C while the block runs.

    One that is ignored (`nohup`) stays ignored. A second signal while the first one is answered
    changes nothing, so that what was done is written whole.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    answered = False

    def end(number: int, _: FrameType | None) -> None:
        nonlocal answered
        if not answered:
            answered = True
            raise Terminated(number)

    before = {number: signal.getsignal(number) for number in ENDINGS}
    for number, handler in before.items():
        if handler is not signal.SIG_IGN:
            signal.signal(number, end)
    try:
        yield
    finally:
        for number, handler in before.items():
            if handler is not None:
                signal.signal(number, handler)
