"""Which frames a report shows, and what is drawn on them."""

from __future__ import annotations

import base64
import io
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image as Pillow

from moveit6d.datasets import video
from moveit6d.datasets.pose_files import PoseRow
from moveit6d.datasets.video import ImageFolder, Prefetched, VideoFrame, read_image
from moveit6d.geometry.pose import Pose
from moveit6d.rendering.backends import make_renderer
from moveit6d.visualization.overlay import GREEN
from moveit6d.visualization.snapshots import WHITE, Look, as_data, draw, evenly, fetch, near, worst


@pytest.mark.parametrize("count", [1, 3, 12])
def test_even_frames_go_from_end_to_end(count: int) -> None:
    frames = list(range(7, 107))
    chosen = evenly(frames, count)
    assert len(chosen) == count and chosen[0] == 7
    if count > 1:
        steps = np.diff(chosen)
        assert chosen[-1] == 106 and steps.max() - steps.min() <= 1
    assert evenly([3, 5], 12) == [3, 5]


def test_the_worst_frames_come_first_and_from_different_places() -> None:
    bad = dict.fromkeys(range(100), 0.01)
    bad |= {40: 0.9, 41: 0.8, 42: 0.7, 80: 0.5, 3: math.inf}
    assert worst(bad, 3) == [3, 40, 80], "apart: 100 // 6 frames"
    assert worst({5: 1.0, 6: 1.0}, 4) == [5, 6]


def write_frames(folder: Path, count: int) -> None:
    folder.mkdir()
    for level in range(count):
        Pillow.new("RGB", (4, 3), (10 * level, 0, 0)).save(folder / f"{level}.png")


def test_only_wanted_image_files_are_opened(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_frames(tmp_path / "frames", 5)
    (tmp_path / "frames" / "3.png").write_bytes(b"broken")
    opened: list[str] = []

    def read(path: Path, depth: Any = None) -> Any:
        opened.append(path.name)
        return read_image(path, depth)

    monkeypatch.setattr(video, "read_image", read)
    found = list(fetch(Prefetched(ImageFolder(tmp_path / "frames")), {3, 1, 9}))
    assert [frame.index for frame in found] == [1, 3] and opened == ["1.png", "3.png"]
    assert found[0].image is not None and found[0].image[0, 0, 0] == 10
    assert found[1].image is None and "3.png" in str(found[1].error)


def test_of_a_video_nothing_is_decoded_after_the_last_wanted_frame() -> None:
    class Video:
        length: int | None = 100
        fps: float | None = None
        given = 0

        def __iter__(self) -> Any:
            for index in range(100):
                self.given += 1
                yield VideoFrame(index, str(index), None)

    video = Video()
    assert [frame.index for frame in fetch(video, {2, 5})] == [2, 5]
    assert video.given <= 7
    assert list(fetch(video, set())) == []


def colored(picture: Any, color: tuple[int, int, int]) -> int:
    return int((np.abs(picture.astype(int) - color).max(-1) < 60).sum())


def test_found_and_true_outlines_are_drawn_and_windows_hold_them(scene: Any) -> None:
    image = np.full((120, 160, 3), 90, np.uint8)
    found, true = (
        Pose(scene.pose(0).rotation, torch.tensor([x, 0.1, 1.0], dtype=torch.float64))
        for x in (-0.2, -0.1)
    )
    look = Look(PoseRow(0, pose=found), True, true)
    picture = draw(image, look, scene.mesh, scene.camera, make_renderer())
    assert colored(picture, GREEN) > 40 > colored(image, GREEN)
    assert colored(picture, WHITE) > 15 > colored(image, WHITE)
    window = near(picture, look, scene.mesh, scene.camera)
    assert window.size < 0.5 * picture.size
    assert window.shape[0] / window.shape[1] == pytest.approx(0.75, abs=0.02)
    assert colored(window, GREEN) == colored(picture, GREEN)
    assert colored(window, WHITE) == colored(picture, WHITE)


def test_a_frame_that_cannot_be_drawn_is_black(scene: Any) -> None:
    look = Look(PoseRow(0), False)
    for image in (None, np.full((5, 5, 3), 9, np.uint8)):
        picture = draw(image, look, scene.mesh, scene.camera, make_renderer())
        assert picture.shape == (120, 160, 3) and not picture.any()
        assert near(picture, look, scene.mesh, scene.camera).shape == picture.shape


def test_pictures_are_jpegs_in_the_page() -> None:
    image = np.zeros((30, 40, 3), np.uint8)
    image[..., 1] = 200
    kind, _, data = as_data(image, 80).partition(",")
    assert kind == "data:image/jpeg;base64"
    picture = Pillow.open(io.BytesIO(base64.b64decode(data)))
    assert picture.size == (80, 60) and abs(np.asarray(picture)[..., 1].mean() - 200) < 5
