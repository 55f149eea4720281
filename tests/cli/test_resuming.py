"""A track that was interrupted is gone on with."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import av
import pytest

from moveit6d.datasets.pose_files import read_poses
from tests.support.clip import Clip

Make = Callable[..., Any]


def frames_in(path: Path) -> int:
    with av.open(str(path)) as container:
        return sum(1 for _ in container.decode(video=0))


def test_a_track_is_gone_on_with(
    clip: Clip, interrupt_update: Callable[[int], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context():
        interrupt_update(3)
        assert clip.track() == 130
    monkeypatch.undo()
    before = (clip.output / "poses.csv").read_text()
    assert clip.track("--resume", "--exact_start") == 2, "begun without --exact_start"
    assert clip.track("--resume", "--contour.lines", "50") == 2, "begun with other settings"
    assert clip.track("--resume") == 0
    assert (clip.output / "poses.csv").read_text().startswith(before)
    rows = read_poses(clip.output / "poses.csv")
    assert [row.frame for row in rows] == [0, 1, 2, 3, 4]
    assert frames_in(clip.output / "overlay_000002.mp4") == 3
    assert clip.summary()["frames"] == 5 and clip.summary()["interrupted"] is False
    assert clip.track("--resume") == 0, "nothing is left to do"
    assert len(read_poses(clip.output / "poses.csv")) == 5
