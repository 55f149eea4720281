"""Frames of folders and video files: order, colours, and bad ones among them."""

from __future__ import annotations

import gc
import itertools
import threading
import weakref
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest
from PIL import Image as Pillow

from moveit6d.datasets.video import (
    ImageFolder,
    ImageList,
    LiveCamera,
    Prefetched,
    VideoFrame,
    open_frames,
)
from moveit6d.errors import InputError

COLORS = [(200, 30, 30), (30, 200, 30), (30, 30, 200), (200, 200, 30), (30, 200, 200)]


def picture(number: int, width: int = 64, height: int = 48) -> np.ndarray:
    return np.full((height, width, 3), COLORS[number % len(COLORS)], np.uint8)


def write_video(path: Path, frames: int, codec: str = "libx264", **options: str) -> Path:
    with av.open(str(path), "w", options=options) as container:
        stream = container.add_stream(codec, rate=Fraction(25))
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        random = np.random.default_rng(0)
        for number in range(frames):
            noisy = picture(number) // 2 + random.integers(0, 100, (48, 64, 3), np.uint8)
            for packet in stream.encode(av.VideoFrame.from_ndarray(noisy, "rgb24")):
                container.mux(packet)
        for packet in stream.encode():
            container.mux(packet)
    return path


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


def test_one_bad_image_does_not_stop_the_others(tmp_path: Path) -> None:
    for number in range(3):
        Pillow.fromarray(picture(number)).save(tmp_path / f"{number}.jpg")
    whole = (tmp_path / "1.jpg").read_bytes()
    (tmp_path / "1.jpg").write_bytes(whole[: len(whole) // 2])
    frames = list(open_frames(tmp_path))
    assert [frame.image is None for frame in frames] == [False, True, False]
    assert frames[1].error is not None and "1.jpg is not a readable image" in frames[1].error


def test_a_video_gives_all_frames_in_rgb(tmp_path: Path) -> None:
    source = open_frames(write_video(tmp_path / "clip.mp4", 12))
    assert source.length == 12 and source.fps == pytest.approx(25)
    frames = list(source)
    assert [frame.index for frame in frames] == list(range(12))
    assert frames[7].name == "clip.mp4#000007"
    for frame in frames:
        assert frame.image is not None and frame.image.shape == (48, 64, 3)
        strongest = np.argsort(frame.image.mean((0, 1)))
        assert strongest[-1] == np.argsort(COLORS[frame.index % 5], kind="stable")[-1] or (
            COLORS[frame.index % 5].count(200) > 1
        )
    assert [f.index for f in source] == list(range(12)), "a file can be read twice"


@pytest.mark.parametrize("suffix", ["mp4", "mkv", "avi"])
def test_a_whole_video_ends_without_complaint(tmp_path: Path, suffix: str) -> None:
    codec = "mpeg4" if suffix == "avi" else "libx264"
    frames = list(open_frames(write_video(tmp_path / f"clip.{suffix}", 30, codec)))
    assert len(frames) == 30 and all(frame.error is None for frame in frames)


@pytest.mark.parametrize("suffix", ["mp4", "mkv", "avi"])
def test_a_cut_off_video_gives_what_it_has_and_says_so(tmp_path: Path, suffix: str) -> None:
    codec = "mpeg4" if suffix == "avi" else "libx264"
    options = {"movflags": "faststart"} if suffix == "mp4" else {}
    path = write_video(tmp_path / f"clip.{suffix}", 50, codec, **options)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(0.6 * len(whole))])
    frames = list(open_frames(path))
    good = [frame for frame in frames if frame.image is not None]
    assert 1 < len(good) < 50
    assert frames[-1].image is None and frames[-1].error is not None
    assert "cut off" in frames[-1].error and str(path) in frames[-1].error
    assert [frame.index for frame in frames] == list(range(len(frames)))


def test_a_damaged_stretch_does_not_end_the_video(tmp_path: Path) -> None:
    path = write_video(tmp_path / "clip.mp4", 50, "mpeg4")
    data = bytearray(path.read_bytes())
    middle = len(data) // 2
    data[middle : middle + 600] = bytes(600)
    path.write_bytes(data)
    frames = list(open_frames(path))
    assert sum(frame.image is not None for frame in frames) > 40


def test_a_video_without_its_index_is_refused_with_a_reason(tmp_path: Path) -> None:
    path = write_video(tmp_path / "clip.mp4", 20)
    path.write_bytes(path.read_bytes()[:800])
    with pytest.raises(InputError, match="not a video that can be opened"):
        open_frames(path)


def test_a_turned_video_stands_upright_as_opencv_shows_it(tmp_path: Path) -> None:
    import cv2

    path = write_video(tmp_path / "clip.mp4", 3)
    # The display matrix of the track header, identity → a quarter turn.
    one, none = (1 << 16).to_bytes(4, "big"), bytes(4)
    last = (1 << 30).to_bytes(4, "big")
    identity = one + none + none + none + one + none + none + none + last
    minus = (-(1 << 16)).to_bytes(4, "big", signed=True)
    quarter = none + one + none + minus + none + none + (48 << 16).to_bytes(4, "big") + none + last
    data = path.read_bytes()
    place = data.index(identity, data.index(b"tkhd"))
    path.write_bytes(data[:place] + quarter + data[place + len(identity) :])
    first = next(iter(open_frames(path))).image
    there, expected = cv2.VideoCapture(str(path)).read()
    assert there and first is not None and first.shape == (64, 48, 3)
    assert np.abs(first.astype(int) - expected[..., ::-1]).mean() < 3


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


def test_a_text_file_is_no_video(tmp_path: Path) -> None:
    (tmp_path / "clip.mp4").write_text("hello")
    with pytest.raises(InputError, match="not a video"):
        open_frames(tmp_path / "clip.mp4")


def test_a_camera_that_is_not_there_is_said() -> None:
    with pytest.raises(InputError, match="camera 97 cannot be opened"):
        open_frames("97")


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
