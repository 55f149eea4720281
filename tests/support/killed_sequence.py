"""A sequence's task whose worker is killed the first time, as by a machine that goes away."""

from __future__ import annotations

import os
import signal
from pathlib import Path

from moveit6d.cli.common import tools
from moveit6d.cli.sequence_job import SequenceJob, Tracked, track_job

FOLDER = "MOVEIT6D_TEST_KILLED"  # environment: where is noted that it happened


def work(job: SequenceJob) -> Tracked:
    """As `sequence_job.work`, but the first worker dies with `easy_01` tracked and not given."""
    found = track_job(job, *tools(job.setting))
    mark = Path(os.environ[FOLDER]) / "killed"
    if job.sequence.name == "easy_01" and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return found
