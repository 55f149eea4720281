"""`moveit6d calibrate`: from the printed page to the camera file."""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest
from PIL import Image

from moveit6d.camera_calibration import Board
from moveit6d.cli.calibrate import TRIED, _spread
from moveit6d.cli.main import main
from moveit6d.datasets.video import VideoFrame, open_frames
from moveit6d.geometry.camera import Camera
from tests.support.board_photos import HEIGHT, STANDARD, WIDTH, photos


def test_photos_become_a_camera_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder, file = tmp_path / "photos", tmp_path / "camera.json"
    folder.mkdir()
    for number, image in enumerate(photos(Board("charuco", 5, 7), STANDARD, 8)):
        Image.fromarray(image).save(folder / f"{number}.png")
    words = ["calibrate", "--video", str(folder), "--squares", "5x7", "--output", str(file)]
    assert main(words) == 0
    said = capsys.readouterr().out
    assert "pictures, corners 0." in said and str(file) in said
    camera = Camera.load(file)
    assert (camera.width, camera.height) == (WIDTH, HEIGHT)
    assert camera.fx == pytest.approx(STANDARD.fx, rel=0.02)
    assert camera.distortion is not None and len(camera.distortion) == 5
    assert set(json.loads(file.read_text())) >= {"reprojection_error", "images"}


@pytest.mark.parametrize("kind", ["charuco", "chessboard"])
def test_the_printed_board_is_found_on_its_page(tmp_path: Path, kind: str) -> None:
    page = tmp_path / "board.png"
    assert main(["calibrate", "--print_board", str(page), "--board", kind]) == 0
    picture = Image.open(page)
    assert picture.size == (2480, 3508) and round(picture.info["dpi"][0]) == 300
    small = np.asarray(picture.convert("RGB").resize((620, 877), Image.Resampling.BOX))
    corners = Board(kind).find(small)  # type: ignore[arg-type]
    assert corners is not None and len(corners.pixels) == 70


def test_a_board_as_pdf(tmp_path: Path) -> None:
    page = tmp_path / "board.pdf"
    assert main(["calibrate", "--print-board", str(page), "--squares", "10x7"]) == 0
    assert page.read_bytes().startswith(b"%PDF")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([], "--print_board FILE"),
        (["--video", "x"], "needed together"),
        (["--print_board", "board.gif"], ".png or .pdf"),
        (["--print_board", "b.png", "--squares", "1x1"], "3 to 50"),
    ],
)
def test_wrong_arguments_are_one_sentence(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["calibrate", *words]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line


def test_photos_without_a_board_or_of_several_sizes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["calibrate", "--video", str(tmp_path), "--output", str(tmp_path / "camera.json")]
    Image.new("RGB", (64, 48)).save(tmp_path / "0.png")
    assert main(words) == 2 and "found in 0 pictures" in capsys.readouterr().err
    Image.new("RGB", (48, 64)).save(tmp_path / "1.png")
    assert main(words) == 2 and "one resolution" in capsys.readouterr().err
    assert not (tmp_path / "camera.json").exists()


def video(path: Path, codec: str, frames: int) -> Path:
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=Fraction(25))
        stream.width, stream.height, stream.pix_fmt = 32, 16, "yuv420p"
        for number in range(frames):
            picture = np.full((16, 32, 3), number % 256, np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, "rgb24")))
        container.mux(stream.encode())
    return path


@pytest.mark.parametrize(
    ("name", "codec"), [("a.mp4", "libx264"), ("a.mkv", "libx264"), ("a.webm", "libvpx")]
)
def test_the_whole_of_a_video_is_used(tmp_path: Path, name: str, codec: str) -> None:
    taken = [f.index for f in _spread(open_frames(video(tmp_path / name, codec, 900)))]
    gaps = [after - before for before, after in itertools.pairwise(taken)]
    assert taken[0] == 0 and taken[-1] >= 896 and max(gaps) <= 4
    assert len(taken) <= 2 * TRIED


class Unending:
    """A source without an end that anyone knows; `live` as a camera's."""

    length = fps = None

    def __init__(self, live: bool, frames: int) -> None:
        self.live, self.frames = live, frames

    def __iter__(self) -> Iterator[VideoFrame]:
        return (VideoFrame(k, str(k), None) for k in range(self.frames))


def test_a_long_video_costs_little_more_and_a_camera_ends() -> None:
    taken = [frame.index for frame in _spread(Unending(False, 1_000_000))]
    assert len(taken) < 8 * TRIED and taken[-1] > 990_000
    assert [f.index for f in _spread(Unending(True, 1_000_000))] == list(range(TRIED))
