"""Commands in processes of their own that are killed, or whose disk is full, without a new start.

`python -m tests.support.forked` loads the library once and forks for every command it is told on
stdin (a line of JSON); nothing has been computed in it, so that forks are sound.
"""

from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

PATIENCE = 300  # seconds that a command may take


class Forks:
    """Runs commands in forks of a process that has loaded the library."""

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "tests.support.forked"],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip

    def run(
        self, *words: str, kill: tuple[str, int] | None = None, bytes_a_file: int | None = None,
        oracle: dict[str, Any] | None = None,
    ) -> tuple[int, str]:  # fmt: skip
        """Exit code (−9 where it was killed) and stderr of `moveit6d WORDS`.

        `kill` is a function ("module:name" or "module:class.name") and the number of its call that
        kills the process. `bytes_a_file` is as large as a file can grow, the rest of which is an
        error of the system's as on a full disk. `oracle` lets a pose decide (mesh, pose, targets).
        """
        case = {"words": words, "kill": kill, "bytes": bytes_a_file, "oracle": oracle}
        assert self._process.stdin is not None and self._process.stdout is not None
        print(json.dumps(case), file=self._process.stdin, flush=True)
        code, said = json.loads(self._process.stdout.readline())
        return code, said

    def end(self) -> None:
        """Let the process end."""
        assert self._process.stdin is not None and self._process.stdout is not None
        self._process.stdin.close()
        self._process.stdout.close()
        self._process.wait(PATIENCE)


def serve() -> None:
    """Fork for every line of stdin and answer with exit code and stderr."""
    for name in ("cli.main", "estimation", "estimation.detection", "evaluation.run_tracker",
                 "policies", "rendering.embree", "datasets.bop"):  # fmt: skip
        import_module(f"moveit6d.{name}")
    for line in sys.stdin:
        reading, writing = os.pipe()
        process = os.fork()
        if process == 0:
            os.close(reading)
            os.dup2(writing, 2)
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
            signal.alarm(PATIENCE)
            code = 1
            try:
                code = _work(json.loads(line))
            except BaseException:
                import traceback

                traceback.print_exc()
            sys.stderr.flush()
            os._exit(code)
        os.close(writing)
        with os.fdopen(reading, encoding="utf-8", errors="replace") as pipe:
            said = pipe.read()
        status = os.waitpid(process, 0)[1]
        print(json.dumps([os.waitstatus_to_exitcode(status), said]), flush=True)


def _work(case: dict[str, Any]) -> int:
    from moveit6d.cli.main import main

    if case["oracle"]:
        _decide(**case["oracle"])
    if case["kill"]:
        _kill_at(*case["kill"])
    if case["bytes"] is not None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (case["bytes"], resource.RLIM_INFINITY))
    return main(case["words"])


def _decide(mesh: str, unit: Any, pose: str, targets: int) -> None:
    from moveit6d import policies
    from moveit6d.geometry.mesh import Mesh
    from moveit6d.geometry.pose import Pose

    inner = Mesh.load(Path(mesh), unit).inner(Pose.load(Path(pose)))
    oracle = policies.OraclePolicy(Pose.stack([inner] * targets))
    policies.load_policy = lambda *_, **__: oracle  # type: ignore[assignment]


def _kill_at(function: str, number: int) -> None:
    module, _, name = function.partition(":")
    holder: Any = import_module(module)
    *path, name = name.split(".")
    for part in path:
        holder = getattr(holder, part)
    whole, calls = getattr(holder, name), [0]

    def counted(*args: Any, **options: Any) -> Any:
        calls[0] += 1
        if calls[0] == number:
            os.kill(os.getpid(), signal.SIGKILL)
        return whole(*args, **options)

    setattr(holder, name, counted)


if __name__ == "__main__":
    serve()
