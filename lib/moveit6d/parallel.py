"""Works through a list of independent tasks: here, in processes beside each other, or on Ray.

Never knows what a task is (a sequence, an image) and never mixes two: the results are those of one
process. A task whose worker was killed is done again once.
"""

from __future__ import annotations

import logging
import os
import pickle
import signal
import traceback
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from threading import current_thread, main_thread
from typing import Any, Generic, TypeVar

from .errors import InputError
from .extras import require

# A task whose worker died is tried this many times more: one death is an accident (someone else's
# memory, a machine that went away), two are the task's own doing.
RETRIES = 1

PATIENCE = 10.0  # seconds in which a worker that has nothing to do must have ended

Item = TypeVar("Item")
Result = TypeVar("Result")
Work = Callable[[Item], Result]


@dataclass(frozen=True)
class JobResult(Generic[Result]):
    """What became of the item with this index: its result, or the sentence that says why not."""

    index: int
    result: Result | None = None
    error: str | None = None


def run_jobs(
    work: Work[Item, Result],
    items: Sequence[Item],
    *,
    jobs: int = 1,
    ray: str | None = None,
    cpus: int = 1,
) -> Iterator[JobResult[Result]]:
    """The outcome of `work(item)` for every item, each as soon as it is there.

    With `jobs` 1 in this process and in order; with more in that many processes beside each other;
    with `ray` on the cluster at that address (`auto`, `ray://HOST:10001`; `local` starts one on
    this machine), `cpus` of it a task. Then `work` must be a function of a module, and everything
    that items name by path must be there under the same path on every machine.

    An `InputError` ends its item only and is its outcome; any other exception is a defect and ends
    everything. Whatever ends the iteration ends the workers.

    Examples:
        >>> [(done.index, done.result) for done in run_jobs(len, ["a", "abc"])]
        [(0, 1), (1, 3)]
    """
    if ray is not None:
        yield from _on_ray(work, items, ray, cpus)
    elif jobs > 1 and len(items) > 1:
        yield from _beside(work, items, min(jobs, len(items)))
    else:
        for index, item in enumerate(items):
            yield _job_result(index, work, item)


def _job_result(index: int, work: Work[Item, Result], item: Item) -> JobResult[Result]:
    try:
        return JobResult(index, work(item))
    except InputError as error:
        return JobResult(index, error=str(error))


def _died(tries: int) -> str:
    return (
        f"its worker died {tries} times (killed, or out of memory); fewer --jobs need less memory"
    )


def _beside(
    work: Work[Item, Result], items: Sequence[Item], jobs: int
) -> Iterator[JobResult[Result]]:
    waiting = deque(range(len(items)))
    tries: Counter[int] = Counter()
    busy: dict[Connection, tuple[_Worker, int]] = {}
    idle = [_Worker() for _ in range(jobs)]
    try:
        while waiting or busy:
            while waiting and idle:
                worker, index = idle.pop(), waiting.popleft()
                tries[index] += 1
                worker.give(index, work, items[index])
                busy[worker.pipe] = (worker, index)
            for pipe in wait(list(busy)):
                assert isinstance(pipe, Connection)
                worker, index = busy[pipe]
                job_result = worker.take()  # raises for a defect: then it is ended with the busy
                del busy[pipe]
                if job_result is not None:
                    idle.append(worker)
                    yield job_result
                    continue
                worker.end()
                idle.append(_Worker())
                if tries[index] <= RETRIES:
                    waiting.appendleft(index)
                else:
                    yield JobResult(index, error=_died(tries[index]))
    finally:
        for worker, _ in busy.values():
            worker.end()
        for worker in idle:  # all of them first: they end by themselves beside each other
            worker.pipe.close()
        for worker in idle:
            worker.end(PATIENCE)


class _Worker:
    """A process that does one task after the other.

    Messages are pickled here: multiprocessing would send every tensor as an open file of its own.
    """

    def __init__(self) -> None:
        context = get_context("spawn")  # forking a process that has run torch can hang
        self.pipe, far = context.Pipe()
        self.process = context.Process(target=_serve, args=(far,), daemon=True)
        self.process.start()
        far.close()

    def give(self, index: int, work: Callable[[Any], Any], item: object) -> None:
        """Let it begin. That it is dead already is noticed by `take`."""
        with suppress(OSError):
            self.pipe.send_bytes(pickle.dumps((index, work, item)))

    def take(self) -> JobResult[Any] | None:
        """What it has sent; None if it died."""
        try:
            found = pickle.loads(self.pipe.recv_bytes())
        except (EOFError, OSError):
            return None
        if isinstance(found, str):
            raise RuntimeError(f"a worker failed:\n{found}")
        assert isinstance(found, JobResult)
        return found

    def end(self, patience: float = 0.0) -> None:
        """Stop it, unless it ends by itself within so many seconds and gives back its locks."""
        self.process.join(patience)
        self.process.kill()
        self.process.join()
        self.pipe.close()


def _serve(pipe: Connection) -> None:
    """What a worker does until nobody sends any more. Ctrl-C is for who gives the tasks."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    while True:
        try:
            index, work, item = pickle.loads(pipe.recv_bytes())
        except (EOFError, OSError):
            return
        try:
            answer: object = _job_result(index, work, item)
        except BaseException:
            answer = traceback.format_exc()
        pipe.send_bytes(pickle.dumps(answer))


def _on_ray(
    work: Work[Item, Result], items: Sequence[Item], address: str, cpus: int
) -> Iterator[JobResult[Result]]:
    ray = _connect(address, cpus)
    # Ray itself does a task again whose worker died; exceptions are never tried again.
    task = ray.remote(max_retries=RETRIES, num_cpus=cpus)(_job_result)
    try:
        running = {task.remote(index, work, item): index for index, item in enumerate(items)}
        while running:
            (done,), _ = ray.wait(list(running))
            index = running.pop(done)
            try:
                yield ray.get(done)
            except (ray.exceptions.WorkerCrashedError, ray.exceptions.OutOfMemoryError):
                yield JobResult(index, error=_died(RETRIES + 1))
    finally:
        ray.shutdown()  # of a cluster that was there before: only leaves it


def _connect(address: str, cpus: int) -> Any:
    """Ray, connected; `InputError` where no machine of the cluster has so many CPUs for a task."""
    require("ray", "--ray")
    import ray

    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # tell nobody
    local: dict[str, Any] = {"include_dashboard": False} if address == "local" else {}
    try:
        with _own_handlers():
            ray.init(address=address, logging_level=logging.ERROR, **local)
    except (ConnectionError, RuntimeError, ValueError) as error:
        raise InputError(
            f"there is no Ray cluster at {address} ({error}); start one with `ray start --head`, "
            "or use --ray local."
        ) from error
    most = max((node["Resources"].get("CPU", 0) for node in ray.nodes()), default=0)
    if cpus > most:
        ray.shutdown()
        raise InputError(
            f"a task is to have {cpus} CPUs, and no machine of the Ray cluster at {address} has "
            f"more than {most:.0f}; give fewer --threads."
        )
    return ray


@contextmanager
def _own_handlers() -> Iterator[None]:
    """What this program does at signals stays: Ray's way to end is to abort."""
    numbers = (signal.SIGTERM, signal.SIGINT)
    heard = {number: signal.getsignal(number) for number in numbers}
    try:
        yield
    finally:
        if current_thread() is main_thread():
            for number, handler in heard.items():
                if handler is not None:
                    signal.signal(number, handler)
