"""Many tasks: the same results everywhere, one more try after a death, errors that stay single."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable
from importlib.machinery import ModuleSpec
from multiprocessing import active_children
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import torch

from moveit6d.errors import InputError
from moveit6d.parallel import JobResult, run_jobs
from tests.support import tasks


def by_index(outcomes: Any) -> list[JobResult[Any]]:
    return sorted(outcomes, key=lambda job_result: job_result.index)


def test_one_process_works_in_order_and_goes_on_after_bad_input() -> None:
    found = list(run_jobs(tasks.square, [2, 13, 3]))
    assert [job_result.index for job_result in found] == [0, 1, 2]
    assert found[0].result == (4, os.getpid()) and found[2].result == (9, os.getpid())
    assert found[1].result is None and found[1].error == "13 brings bad luck."
    assert list(run_jobs(tasks.square, [])) == []


def test_two_workers_give_the_same_results_and_one_may_be_killed(tmp_path: Path) -> None:
    # 0 kills its worker once, 3 kills two of them; nothing else notices.
    items = [(number, tmp_path, {0: 1, 3: 2}.get(number, 0)) for number in range(6)]
    found = by_index(run_jobs(tasks.square_or_die, items, jobs=2))
    assert [job_result.result for job_result in found] == [0, 1, 4, None, 16, 25]
    assert "died 2 times" in str(found[3].error)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["0.0", "3.0", "3.1"]


def test_workers_are_other_processes_and_bad_input_is_a_result() -> None:
    found = by_index(run_jobs(tasks.square, [5, 13, 6, 7], jobs=2))
    assert [job_result.error for job_result in found] == [None, "13 brings bad luck.", None, None]
    results = [job_result.result for job_result in found if job_result.result is not None]
    assert [square for square, _ in results] == [25, 36, 49]
    assert os.getpid() not in {process for _, process in results}


def test_a_defect_in_a_worker_is_shown_and_ends_everything() -> None:
    with pytest.raises(RuntimeError, match="ZeroDivisionError: a defect"):
        list(run_jobs(tasks.square, [99, 99], jobs=2))


def test_a_worker_whose_task_failed_has_ended_when_that_is_said() -> None:
    before = set(active_children())
    try:
        list(run_jobs(tasks.square, [99, 5], jobs=2))
    except RuntimeError:  # whose traceback still holds the worker
        assert set(active_children()) <= before
    else:
        pytest.fail("the defect is hidden")


def test_results_may_hold_more_tensors_than_open_files() -> None:
    import resource

    limits = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (256, limits[1]))
    try:
        found = by_index(run_jobs(tasks.many_tensors, [600, 0], jobs=2))
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, limits)
    assert found[0].result is not None and len(found[0].result) == 600
    torch.testing.assert_close(found[0].result[599], torch.full((3,), 599.0))


def test_workers_that_have_nothing_left_to_do_end_by_themselves(tmp_path: Path) -> None:
    # Killed ones would leave their locks to Python, which complains of them.
    marks = [tmp_path / "first", tmp_path / "second"]
    assert len(list(run_jobs(tasks.goodbye, marks, jobs=2))) == 2
    assert all(mark.exists() for mark in marks)


def test_ray_is_named_where_it_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(InputError, match=r"pip install 'moveit6d\[ray\]'"):
        list(run_jobs(tasks.square, [1], ray="local"))


class OneSmallMachine(SimpleNamespace):
    """Ray, on a machine of two processors; it takes SIGTERM for itself, as Ray does."""

    def init(self, **_: object) -> None:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)

    def nodes(self) -> list[dict[str, Any]]:
        return [{"Resources": {"CPU": 2.0}}, {"Resources": {"memory": 1.0}}]

    def shutdown(self) -> None:
        self.ended = True


def test_more_processors_than_a_machine_of_the_cluster_has_are_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ray = OneSmallMachine(__spec__=ModuleSpec("ray", None))
    monkeypatch.setitem(sys.modules, "ray", ray)
    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(InputError, match=r"to have 3 CPUs.*more than 2; give fewer --threads"):
        list(run_jobs(tasks.square, [1], ray="local", cpus=3))
    assert ray.ended and signal.getsignal(signal.SIGTERM) is before


@pytest.mark.filterwarnings("ignore")  # Ray's own
def test_a_ray_cluster_gives_the_same_results_and_one_worker_may_be_killed(tmp_path: Path) -> None:
    pytest.importorskip("ray")
    work = on_ray(tmp_path)
    found = by_index(run_jobs(work, [1, 13, 2, 5], ray="local"))
    assert [job_result.result for job_result in found] == [1, None, 4, 25]
    assert found[1].error == "13 brings bad luck."
    assert (tmp_path / "killed").exists()


def on_ray(folder: Path) -> Callable[[int], int]:
    """Squares; 2 kills its worker once, 13 is refused. Local, as Ray sends those as a whole."""

    def work(item: int) -> int:
        import os
        import signal

        from moveit6d.errors import InputError

        mark = folder / "killed"
        if item == 2 and not mark.exists():
            mark.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        if item == 13:
            raise InputError("13 brings bad luck.")
        return item * item

    return work
