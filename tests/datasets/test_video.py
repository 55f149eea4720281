"""Frames of folders and video files: order, colours, and bad ones among them."""

from __future__ import annotations

import gc
import itertools
import threading
import weakref
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image as Pillow

from moveit6d.datasets import video
from moveit6d.datasets.video import (
    ImageFolder,
    ImageList,
    LiveCamera,
    Prefetched,
    VideoFrame,
    open_frames,
    read_image,
)
from moveit6d.errors import InputError

COLORS = [(200, 30, 30), (30, 200, 30), (30, 30, 200), (200, 200, 30), (30, 200, 200)]


def picture(number: int, width: int = 64, height: int = 48) -> np.ndarray:
    return np.full((height, width, 3), COLORS[number % len(COLORS)], np.uint8)


def test_a_folder_gives_its_images_in_order_of_numbers(tmp_path: Path) -> None:
    for name, number in (("10.png", 2), ("9.png", 1), ("1.PNG", 0)):
        Pillow.fromarray(picture(number)).save(tmp_path / name)
    (tmp_path / "notes.txt").write_text("no image")
    (tmp_path / ".hidden.png").write_text("no image")
    source = open_frames(tmp_path)
    assert source.length == 3
    frames = list(source)
    assert [frame.name for frame in frames] == ["1.PNG", "9.png", "10.png"]
    assert [frame.index for frame in frames] == [0, 1, 2]
    for number, frame in enumerate(frames):
        assert frame.image is not None and frame.error is None
        np.testing.assert_array_equal(frame.image, picture(number))
    assert len(list(source)) == 3, "a folder can be read twice"


@pytest.mark.parametrize("pattern", ["*-color.png", "%06d-color.png"])
def test_of_several_series_one_must_be_chosen(tmp_path: Path, pattern: str) -> None:
    for number in range(3):
        for what in ("color", "depth", "label"):
            shade = picture(number if what == "color" else 4)
            Pillow.fromarray(shade).save(tmp_path / f"{number:06}-{what}.png")
    with pytest.raises(InputError, match="holds 3 series of images") as caught:
        open_frames(tmp_path)
    assert f"give the one to read, as '{tmp_path}/*-color.png'" in str(caught.value)
    frames = list(open_frames(str(tmp_path / pattern)))
    assert [frame.name for frame in frames] == [f"{number:06}-color.png" for number in range(3)]
    np.testing.assert_array_equal(frames[2].image, picture(2))
    assert open_frames(tmp_path / "*").length == 9
    with pytest.raises(InputError, match=r"-rgb\.png does not exist: give a folder of images, or"):
        open_frames(tmp_path / "*-rgb.png")
    with pytest.raises(InputError, match="does not exist"):
        open_frames(tmp_path / "nowhere" / pattern)


def test_time_stamps_come_in_order_of_time(tmp_path: Path) -> None:
    for time in ("164.033", "164.066", "164.33", "165.0"):
        Pillow.fromarray(picture(0)).save(tmp_path / f"{time}.png")
    names = [frame.name[:-4] for frame in open_frames(tmp_path)]
    assert names == ["164.033", "164.066", "164.33", "165.0"]


def test_one_bad_image_does_not_stop_the_others(tmp_path: Path) -> None:
    for number in range(3):
        Pillow.fromarray(picture(number)).save(tmp_path / f"{number}.jpg")
    whole = (tmp_path / "1.jpg").read_bytes()
    (tmp_path / "1.jpg").write_bytes(whole[: len(whole) // 2])
    frames = list(open_frames(tmp_path))
    assert [frame.image is None for frame in frames] == [False, True, False]
    assert frames[1].error is not None and "1.jpg is not a readable image" in frames[1].error


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda path: path / "nothing.mp4", "does not exist"),
        (lambda path: path, "holds no images"),
    ],
)
def test_what_is_not_there_is_said(tmp_path: Path, make: object, words: str) -> None:
    with pytest.raises(InputError, match=words):
        open_frames(make(tmp_path))  # type: ignore[operator]


@pytest.mark.parametrize("index", ["97", 97, np.int64(97), np.array(97, np.uint8)])
def test_a_camera_that_is_not_there_is_said(index: Any) -> None:
    with pytest.raises(InputError, match="camera 97 cannot be opened"):
        open_frames(index)


@pytest.mark.parametrize("index", [-1, np.int64(-1), 2**31])
def test_an_index_that_no_camera_has_is_said(index: Any) -> None:
    with pytest.raises(InputError, match="counts from 0, found"):
        open_frames(index)


@pytest.mark.parametrize("source", [None, 0.0, True, b"clip.mp4", ["a.jpg"]])
def test_what_names_no_frames_is_said(source: Any) -> None:
    with pytest.raises(InputError, match=r"Frames come from a folder .* or a camera index, found"):
        open_frames(source)


def test_a_folder_named_like_a_number_is_a_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "0").mkdir()
    Pillow.fromarray(picture(0)).save(tmp_path / "0" / "a.png")
    monkeypatch.chdir(tmp_path)
    assert isinstance(open_frames("0"), ImageFolder)


def test_a_camera_gives_rgb_and_ends_when_it_is_gone(monkeypatch: pytest.MonkeyPatch) -> None:
    import cv2

    class Device:
        def __init__(self, index: int) -> None:
            self.left = 2

        def isOpened(self) -> bool:
            return True

        def get(self, key: int) -> float:
            return 30.0

        def read(self) -> tuple[bool, np.ndarray | None]:
            self.left -= 1
            return (True, picture(0)[..., ::-1]) if self.left >= 0 else (False, None)

        def release(self) -> None:
            pass

    monkeypatch.setattr(cv2, "VideoCapture", Device)
    camera = open_frames(0)
    assert isinstance(camera, LiveCamera) and camera.length is None and camera.fps == 30
    frames: list[VideoFrame] = list(itertools.islice(camera, 100))
    assert len(frames) == 32
    assert frames[0].image is not None
    np.testing.assert_array_equal(frames[0].image, picture(0))
    assert frames[-1].error == "camera 0 gave no frame."


class Counted:
    """Many frames, of which it is known how many were made and how many are still held."""

    length: int | None = 3000
    fps: float | None = None

    def __init__(self, stop: int = 3000) -> None:
        self.made, self.stop = 0, stop
        self.held: weakref.WeakSet[Held] = weakref.WeakSet()
        self.most = 0

    def __iter__(self) -> Iterator[VideoFrame]:
        for number in range(self.stop):
            self.made += 1
            image = np.zeros((8, 8, 3), np.uint8).view(Held)
            self.held.add(image)
            self.most = max(self.most, len(self.held))
            yield VideoFrame(number, str(number), image)
            del image
        if self.stop < 3000:
            raise InputError("the disk is gone.")


class Held(np.ndarray):
    """An array that can be watched."""

    __hash__ = object.__hash__  # type: ignore[assignment]


def test_reading_ahead_keeps_order_and_holds_few_frames() -> None:
    source = Counted()
    frames = Prefetched(source, ahead=3)
    assert frames.length == 3000 and frames.fps is None
    assert [frame.index for frame in frames] == list(range(3000))
    # Three in the queue, one waiting to go in, one with the caller, one being let go.
    assert source.most <= 6


def test_reading_ahead_stops_when_the_caller_does() -> None:
    source = Counted()
    before = threading.active_count()
    for frame in Prefetched(source):
        if frame.index == 5:
            break
    del frame
    gc.collect()
    assert threading.active_count() == before
    assert source.made < 15


def test_errors_of_the_reading_thread_reach_the_caller() -> None:
    frames = iter(Prefetched(Counted(stop=4)))
    assert [next(frames).index for _ in range(4)] == [0, 1, 2, 3]
    with pytest.raises(InputError, match="the disk is gone"):
        next(frames)


def test_listed_images_come_in_their_own_order(tmp_path: Path) -> None:
    paths = [tmp_path / name for name in ("b.png", "a.png", "missing.png")]
    for number, path in enumerate(paths[:2]):
        Pillow.fromarray(picture(number)).save(path)
    frames = list(ImageList(paths))
    assert [frame.name for frame in frames] == ["b.png", "a.png", "missing.png"]
    np.testing.assert_array_equal(frames[1].image, picture(1))
    assert frames[2].image is None and "does not exist" in (frames[2].error or "")


def test_a_frame_asked_for_twice_in_a_row_is_decoded_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    paths = [tmp_path / name for name in ("a.png", "b.png")]
    for number, path in enumerate(paths):
        Pillow.fromarray(picture(number)).save(path)
    read: list[str] = []

    def recorded(path: Path, depth: Any) -> Any:
        read.append(path.name)
        return read_image(path, depth)

    monkeypatch.setattr(video, "read_image", recorded)
    images = ImageList(paths)
    first = images.frame(0)
    assert first.image is not None
    first.image[:] = 0  # a caller may draw on it
    frames = list(images)
    assert read == ["a.png", "b.png"]
    for number, frame in enumerate(frames):
        np.testing.assert_array_equal(frame.image, picture(number))
