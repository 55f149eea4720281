"""Written videos play: right size, right colours, whole after an interruption, absent if empty."""

from __future__ import annotations

import resource
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
from PIL import Image

from moveit6d.errors import InputError
from moveit6d.visualization import video
from moveit6d.visualization.video import VideoWriter


def frame(level: int, height: int = 48, width: int = 64) -> np.ndarray:
    image = np.zeros((height, width, 3), np.uint8)
    image[..., 0], image[..., 2] = level, 255 - level
    return image


def frames_of(path: Path) -> list[np.ndarray]:
    with av.open(str(path)) as container:
        return [picture.to_ndarray(format="rgb24") for picture in container.decode(video=0)]


def test_what_is_written_is_played(tmp_path: Path) -> None:
    path = tmp_path / "new" / "overlay.mp4"
    with VideoWriter(path, fps=30) as movie:
        for level in range(0, 250, 25):
            movie.write(frame(level))
        assert not path.exists(), "a video appears when it is finished"
    found = frames_of(path)
    assert len(found) == 10 and found[0].shape == (48, 64, 3)
    for level, picture in zip(range(0, 250, 25), found, strict=True):
        assert abs(picture[..., 0].mean() - level) < 12
        assert abs(picture[..., 2].mean() - (255 - level)) < 12
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        assert stream.codec_context.pix_fmt == "yuv420p", "what every player can show"
        assert float(stream.average_rate) == pytest.approx(30)
    assert list(path.parent.iterdir()) == [path]


def test_every_kind_of_image_is_a_frame(tmp_path: Path) -> None:
    path, image = tmp_path / "v.mp4", frame(100)
    grey = np.full((48, 64), 100, np.uint8)
    kinds: list[tuple[Any, int]] = [
        (grey, 100),
        (image / 255, 155),
        (np.dstack([image, grey]), 155),
        (Image.fromarray(image), 155),
    ]
    for first, blue in kinds:
        with VideoWriter(path) as movie:
            movie.write(first)
        (found,) = frames_of(path)
        assert abs(found[..., 2].mean() - blue) < 12


@pytest.mark.parametrize(
    ("bad", "words"),
    [
        (np.full((48, 64, 3), 100.0), "divide it by 255"),
        (np.zeros((48, 64, 2), np.uint8), r"expected shape \(H, W, 3\)"),
        ("frame.png", "expected an array"),
    ],
)
def test_what_is_no_image_is_said_and_leaves_no_file(tmp_path: Path, bad: Any, words: str) -> None:
    with pytest.raises(InputError, match=words), VideoWriter(tmp_path / "v.mp4") as movie:
        movie.write(bad)
    assert list(tmp_path.iterdir()) == []


def test_ctrl_c_leaves_a_whole_video(tmp_path: Path) -> None:
    path = tmp_path / "overlay.mp4"
    with pytest.raises(KeyboardInterrupt), VideoWriter(path) as movie:
        for level in range(7):
            movie.write(frame(level))
        raise KeyboardInterrupt
    assert len(frames_of(path)) == 7 and list(tmp_path.iterdir()) == [path]


def test_odd_sizes_and_changing_sizes_are_written(tmp_path: Path) -> None:
    path = tmp_path / "overlay.mp4"
    with VideoWriter(path) as movie:
        movie.write(frame(10, 49, 65))
        movie.write(frame(200, 24, 32))
    found = frames_of(path)
    assert [picture.shape for picture in found] == [(48, 64, 3)] * 2
    assert abs(found[1][..., 0].mean() - 200) < 12


@pytest.mark.parametrize("size", [100, 3000, 30_000])
def test_a_full_disk_leaves_no_half_video(tmp_path: Path, size: int) -> None:
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, limit[1]))  # as far as a file can grow
    random = np.random.default_rng(0)
    try:
        with (
            pytest.raises(InputError, match=r"overlay\.mp4 cannot be written: File too large"),
            VideoWriter(tmp_path / "overlay.mp4") as movie,
        ):
            for _ in range(60):
                movie.write(random.integers(0, 255, (48, 64, 3), np.uint8))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)
    assert list(tmp_path.iterdir()) == []


def test_no_frame_no_file(tmp_path: Path) -> None:
    with VideoWriter(tmp_path / "overlay.mp4"):
        pass
    with pytest.raises(InputError, match="mesh"), VideoWriter(tmp_path / "overlay.mp4"):
        raise InputError("no such mesh")
    assert list(tmp_path.iterdir()) == []


def test_a_path_may_be_text(tmp_path: Path) -> None:
    path = str(tmp_path / "overlay.mp4")
    with VideoWriter(path) as movie:
        movie.write(frame(10))
    assert len(frames_of(Path(path))) == 1


def test_frames_are_written_inside_of_the_block_only(tmp_path: Path) -> None:
    path = tmp_path / "overlay.mp4"
    with VideoWriter(path) as movie:
        movie.write(frame(10))
    good = path.read_bytes()
    for writer in (movie, VideoWriter(path)):
        with pytest.raises(InputError, match="inside of `with VideoWriter"):
            writer.write(frame(10))
    assert path.read_bytes() == good and list(tmp_path.iterdir()) == [path]


def test_each_block_of_one_writer_is_a_video(tmp_path: Path) -> None:
    movie = VideoWriter(tmp_path / "overlay.mp4")
    for count in (1, 3):
        with movie:
            for _ in range(count):
                movie.write(frame(10))
        assert len(frames_of(movie.path)) == count
    with movie:
        movie.write(frame(10))
        with pytest.raises(InputError, match="is being written already"), movie:
            pass
    assert len(frames_of(movie.path)) == 1


@pytest.mark.parametrize(("fps", "expected"), [
    (np.float32(10), 10), ("30", 30), (float("nan"), 25), (0, 25), (1e-9, 25),
    (30000 / 1001, 29.97),
])  # fmt: skip
def test_a_rate_of_any_kind_of_number(tmp_path: Path, fps: Any, expected: float) -> None:
    with VideoWriter(tmp_path / "a.mp4", fps) as movie:
        movie.write(frame(0))
    with av.open(str(movie.path)) as container:
        assert float(container.streams.video[0].average_rate) == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize("fps", ["fast", [25]])
def test_a_rate_that_is_no_number_is_said(tmp_path: Path, fps: Any) -> None:
    with pytest.raises(InputError, match="fps must be a number"):
        VideoWriter(tmp_path / "a.mp4", fps)


def test_a_codec_that_is_not_there_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(video, "CODECS", ("none such",))
    monkeypatch.setattr(video, "QUALITY", {"none such": {}})
    with (
        pytest.raises(InputError, match=r"a\.mp4 cannot be written: none such"),
        VideoWriter(tmp_path / "a.mp4") as movie,
    ):
        movie.write(frame(0))
    assert list(tmp_path.iterdir()) == []


def test_a_place_that_cannot_be_written_is_said(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with (
        pytest.raises(InputError, match="cannot be written"),
        VideoWriter(tmp_path / "file" / "overlay.mp4"),
    ):
        pass


def test_a_frame_too_small_for_video_is_said(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="make no video"), VideoWriter(tmp_path / "a.mp4") as movie:
        movie.write(frame(0, 1, 1))
    assert list(tmp_path.iterdir()) == []


def test_the_other_codec_has_the_quality_that_is_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    picture = np.random.default_rng(0).integers(0, 255, (64, 64, 3), np.uint8)
    sizes = []
    for quality in ("3", "31"):
        monkeypatch.setattr(video, "CODECS", ("mpeg4",))
        if quality != "3":
            monkeypatch.setitem(video.QUALITY, "mpeg4", {"qmin": quality, "qmax": quality})
        with VideoWriter(tmp_path / f"{quality}.mp4") as writer:
            writer.write(picture)
        sizes.append((tmp_path / f"{quality}.mp4").stat().st_size)
    assert sizes[0] > 2 * sizes[1]
