"""Tasks for workers in other processes, who can only be given functions of modules."""

from __future__ import annotations

import atexit
import os
import signal
from pathlib import Path
from typing import Any

from moveit6d.errors import InputError


def square(item: int) -> tuple[int, int]:
    """The square and who computed it; refuses 13."""
    if item == 13:
        raise InputError("13 brings bad luck.")
    if item == 99:
        raise ZeroDivisionError("a defect")
    return item * item, os.getpid()


def many_tensors(count: int) -> list[Any]:
    """More tensors than a process may have open files."""
    if not count:
        return []
    import torch  # here: the other workers start quickly without it

    return [torch.full((3,), float(k)) for k in range(count)]


def square_or_die(item: tuple[int, Path, int]) -> int:
    """The square; the worker is killed the first times, as many as the item says."""
    number, folder, deaths = item
    for death in range(deaths):
        mark = folder / f"{number}.{death}"
        if not mark.exists():
            mark.touch()
            os.kill(os.getpid(), signal.SIGKILL)
    return number * number


def goodbye(path: Path) -> None:
    """Leaves the file when its process ends by itself."""
    atexit.register(path.touch)
