"""Frames of video files: order, colours, cut and damaged ones, and files that are none."""

from __future__ import annotations

import tarfile
import zipfile
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest
from av.video.reformatter import ColorRange, Colorspace
from PIL import Image as Pillow

from moveit6d.datasets.video import UNSPECIFIED, open_frames
from moveit6d.datasets.video_file import VideoFile
from moveit6d.errors import InputError

COLORS = [(200, 30, 30), (30, 200, 30), (30, 30, 200), (200, 200, 30), (30, 200, 200)]


def picture(number: int, width: int = 64, height: int = 48) -> np.ndarray:
    return np.full((height, width, 3), COLORS[number % len(COLORS)], np.uint8)


def write_video(
    path: Path, frames: int, codec: str = "libx264", aspect: Fraction | None = None, **options: str
) -> Path:
    with av.open(str(path), "w", options=options) as container:
        stream = container.add_stream(codec, rate=Fraction(25))
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        if aspect is not None:
            stream.codec_context.sample_aspect_ratio = aspect
        random = np.random.default_rng(0)
        for number in range(frames):
            noisy = picture(number) // 2 + random.integers(0, 100, (48, 64, 3), np.uint8)
            for packet in stream.encode(av.VideoFrame.from_ndarray(noisy, "rgb24")):
                container.mux(packet)
        for packet in stream.encode():
            container.mux(packet)
    return path


def turn_a_quarter(path: Path) -> None:
    """As phones do it that are held upright: the pictures stay, a matrix says how to show them."""
    # The display matrix of the track header, identity → a quarter turn.
    one, none = (1 << 16).to_bytes(4, "big"), bytes(4)
    last = (1 << 30).to_bytes(4, "big")
    identity = one + none + none + none + one + none + none + none + last
    minus = (-(1 << 16)).to_bytes(4, "big", signed=True)
    quarter = none + one + none + minus + none + none + (48 << 16).to_bytes(4, "big") + none + last
    data = path.read_bytes()
    place = data.index(identity, data.index(b"tkhd"))
    path.write_bytes(data[:place] + quarter + data[place + len(identity) :])


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
    turn_a_quarter(path)
    first = next(iter(open_frames(path))).image
    there, expected = cv2.VideoCapture(str(path)).read()
    assert there and first is not None and first.shape == (64, 48, 3)
    assert np.abs(first.astype(int) - expected[..., ::-1]).mean() < 3


def test_a_text_file_is_no_video(tmp_path: Path) -> None:
    (tmp_path / "clip.mp4").write_text("hello")
    with pytest.raises(InputError, match="not a video"):
        open_frames(tmp_path / "clip.mp4")


@pytest.mark.parametrize("form", ["zip", "tar"])
def test_an_archive_is_to_be_unpacked(tmp_path: Path, form: str) -> None:
    """Of which ffmpeg would show the first picture."""
    image, path = tmp_path / "0.jpg", tmp_path / f"frames.{form}"
    Pillow.fromarray(picture(0)).save(image)
    if form == "zip":
        with zipfile.ZipFile(path, "w") as archive:
            archive.write(image, "0.jpg")
    else:
        with tarfile.open(path, "w") as archive:
            archive.add(image, "0.jpg")
    with pytest.raises(InputError, match="is an archive; unpack it"):
        open_frames(path)


def test_a_tiff_of_many_pages_is_not_one_frame(tmp_path: Path) -> None:
    first, *others = (Pillow.fromarray(picture(number)) for number in range(4))
    first.save(tmp_path / "stack.tif", save_all=True, append_images=others)
    with pytest.raises(InputError, match="a TIFF file of 4 pages; save each"):
        open_frames(tmp_path / "stack.tif")
    first.save(tmp_path / "one.tif")
    (frame,) = open_frames(tmp_path / "one.tif")
    np.testing.assert_array_equal(frame.image, picture(0))


def test_pixels_that_are_no_squares_are_told(tmp_path: Path) -> None:
    assert VideoFile(write_video(tmp_path / "square.mp4", 2)).sample_aspect_ratio == 1
    wide = write_video(tmp_path / "wide.mp4", 2, aspect=Fraction(4, 3))
    assert VideoFile(wide).sample_aspect_ratio == pytest.approx(4 / 3)
    turn_a_quarter(wide)
    assert VideoFile(wide).sample_aspect_ratio == pytest.approx(3 / 4)


def one_colour(path: Path, height: int, matrix: int, tag: int | None, full: bool = False) -> Path:
    """A video of RGB (200, 40, 60), converted with a matrix that it may name, as coders do."""
    spread = ColorRange.JPEG if full else ColorRange.MPEG
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=Fraction(25), options={"crf": "1"})
        stream.width, stream.height, stream.pix_fmt = 2 * height, height, "yuv420p"
        if full:
            stream.codec_context.color_range = spread
        if tag is not None:
            stream.codec_context.colorspace = tag
        rgb = np.full((height, 2 * height, 3), (200, 40, 60), np.uint8)
        picture = av.VideoFrame.from_ndarray(rgb, "rgb24").reformat(
            format="yuv420p", dst_colorspace=matrix, dst_color_range=spread
        )
        picture.colorspace = UNSPECIFIED if tag is None else tag
        for packet in (*stream.encode(picture), *stream.encode()):
            container.mux(packet)
    return path


@pytest.mark.parametrize(
    ("height", "matrix", "tag", "full"),
    [
        (720, Colorspace.ITU709, None, False),
        (720, Colorspace.ITU709, None, True),
        (720, Colorspace.ITU709, 1, False),
        (720, Colorspace.ITU601, 5, False),  # as it says, although it is large
        (480, Colorspace.ITU601, None, False),
        (480, Colorspace.ITU709, 1, False),
    ],
)
def test_colours_are_those_of_the_standard(
    tmp_path: Path, height: int, matrix: Colorspace, tag: int | None, full: bool
) -> None:
    path = one_colour(tmp_path / "clip.mp4", height, int(matrix), tag, full)
    (frame,) = open_frames(path)
    assert frame.image is not None
    np.testing.assert_allclose(frame.image[99, 99], (200, 40, 60), atol=4)
