"""Few threads inside, the caller's after; nested, in several Python threads, and after errors."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import cv2
import pytest
import torch

from moveit6d.errors import InputError
from moveit6d.threads import checked_threads, limited_threads, with_own_threads


@pytest.fixture(autouse=True)
def _as_it_was() -> Iterator[None]:
    before = (torch.get_num_threads(), cv2.getNumThreads())
    torch.set_num_threads(3)
    cv2.setNumThreads(2)
    yield
    torch.set_num_threads(before[0])
    cv2.setNumThreads(before[1])


def both() -> tuple[int, int]:
    return torch.get_num_threads(), cv2.getNumThreads()


def test_the_callers_numbers_come_back() -> None:
    with limited_threads(1):
        assert both() == (1, 1)
        with limited_threads(2):
            assert both() == (2, 2)
        assert torch.get_num_threads() == 1
    assert both() == (3, 2)
    with limited_threads(None):
        assert both() == (3, 2)


def test_they_come_back_after_an_error() -> None:
    with pytest.raises(ZeroDivisionError), limited_threads(1):
        raise ZeroDivisionError
    assert both() == (3, 2)


def test_a_thread_that_begins_inside_another_s_block_gets_the_callers_number_back() -> None:
    inside, done, seen = threading.Event(), threading.Event(), []

    def other() -> None:
        with limited_threads(1):
            inside.set()
            done.wait(10)
        seen.append(torch.get_num_threads())

    first = threading.Thread(target=other)
    first.start()
    inside.wait(10)

    def late() -> None:
        with limited_threads(1):
            pass
        seen.append(torch.get_num_threads())

    second = threading.Thread(target=late)
    second.start()
    second.join()
    done.set()
    first.join()
    assert seen == [3, 3] and both() == (3, 2)


def test_methods_compute_with_their_objects_number() -> None:
    class Worker:
        threads: int | None = 1

        @with_own_threads
        def count(self, plus: int = 0) -> int:
            """How many there are."""
            return torch.get_num_threads() + plus

    worker = Worker()
    assert worker.count(plus=1) == 2 and Worker.count.__doc__ == "How many there are."
    worker.threads = None
    assert worker.count() == 3


@pytest.mark.parametrize("count", [0, -1, 1.5, True, "2"])
def test_numbers_that_are_none_are_refused(count: object) -> None:
    with pytest.raises(InputError, match="threads"):
        checked_threads(count)  # type: ignore[arg-type]
