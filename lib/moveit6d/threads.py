"""CPU threads of the numerical libraries: few while something here computes, the caller's after.

Never changes what a caller has set for longer than a call. More threads than free cores wait for
each other at every operator of a network this small: beside one busy process two of them are ten
to fifty times slower than one.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from typing import Any, Protocol, TypeVar

from .errors import InputError

Method = TypeVar("Method", bound=Callable[..., Any])

_lock = threading.Lock()
_here = threading.local()  # how deep this Python thread's blocks are nested
_blocks = 0  # that are open now, in all of the process's Python threads
_callers = (1, 1)  # numbers of torch's and OpenCV's threads before the first of them


class HasThreads(Protocol):
    """Whatever has a number of threads to compute with; None leaves the caller's."""

    threads: int | None


@contextmanager
def limited_threads(count: int | None) -> Iterator[None]:
    """Torch and OpenCV with this many threads in the block; None changes nothing.

    The caller's numbers come back when the block ends, however it ends. Blocks may be nested and
    run in several Python threads at once.
    """
    global _blocks, _callers
    if count is None:
        yield
        return
    import cv2
    import torch

    depth = getattr(_here, "depth", 0)
    with _lock:
        if not _blocks:
            _callers = (torch.get_num_threads(), cv2.getNumThreads())
        # A Python thread that begins while another one's block is open inherits that one's number.
        before = torch.get_num_threads() if depth else _callers[0]
        _blocks, _here.depth = _blocks + 1, depth + 1
    torch.set_num_threads(count)
    cv2.setNumThreads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)
        with _lock:
            _blocks, _here.depth = _blocks - 1, depth
            if not _blocks:
                cv2.setNumThreads(_callers[1])


def with_own_threads(method: Method) -> Method:
    """A method that computes with its object's number of `threads`."""

    @wraps(method)
    def limited(self: HasThreads, *args: Any, **options: Any) -> Any:
        with limited_threads(self.threads):
            return method(self, *args, **options)

    return limited  # type: ignore[return-value]


def checked_threads(count: int | None) -> int | None:
    """The number itself; `InputError` unless it is None or a whole number above zero."""
    if count is not None and (not isinstance(count, int) or isinstance(count, bool) or count < 1):
        raise InputError(f"threads must be a whole number above 0, or None, found {count!r}.")
    return count
