"""The camera of a command: from a file, or from the field of view and the images' size."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from moveit6d.cli.camera_options import add_camera_options, camera_of
from moveit6d.datasets.pose_files import write_camera
from moveit6d.datasets.video import ImageFolder
from moveit6d.errors import InputError
from moveit6d.geometry.camera import Camera


def parsed(*words: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    add_camera_options(parser)
    return parser.parse_args(words)


@pytest.fixture
def frames(tmp_path: Path) -> ImageFolder:
    """A damaged picture, and one of 80 × 60 pixels."""
    folder = tmp_path / "frames"
    folder.mkdir()
    (folder / "0.png").write_bytes(b"no picture")
    Image.fromarray(np.zeros((60, 80, 3), np.uint8)).save(folder / "1.png")
    return ImageFolder(folder)


def test_a_file_is_read(tmp_path: Path, frames: ImageFolder) -> None:
    camera = Camera(100.0, 101.0, 39.5, 29.5, 80, 60)
    write_camera(tmp_path / "camera.json", camera)
    assert camera_of(parsed("--camera", str(tmp_path / "camera.json")), frames) == camera


def test_a_field_of_view_is_that_of_the_longer_side(frames: ImageFolder) -> None:
    camera = camera_of(parsed("--fov", "90"), frames)
    assert (camera.width, camera.height) == (80, 60)
    edges = np.array([-0.5, 79.5])  # of the pixels at the image's ends
    left, right = (edges - camera.cx) / camera.fx
    assert math.degrees(math.atan(right) - math.atan(left)) == pytest.approx(90)


def test_without_any_frame_the_size_is_missing(frames: ImageFolder) -> None:
    only_bad = ImageFolder(frames.paths[0].parent)
    only_bad.paths = only_bad.paths[:1]
    with pytest.raises(InputError, match="no frame can be read"):
        camera_of(parsed("--fov", "90"), only_bad)


def test_one_of_both_is_needed() -> None:
    for words in ([], ["--camera", "c.json", "--fov", "60"]):
        with pytest.raises(SystemExit):
            parsed(*words)


def test_pixels_that_are_no_squares_have_two_focal_lengths() -> None:
    """The field of view is that of the picture as it is shown: here 106.67 × 60."""

    class Anamorphic:
        length, fps, size, sample_aspect_ratio = 0, None, (80, 60), 4 / 3

    camera = camera_of(parsed("--fov", "90"), Anamorphic())  # type: ignore[arg-type]
    assert (camera.width, camera.height, camera.cx, camera.cy) == (80, 60, 39.5, 29.5)
    assert camera.fx == pytest.approx(40)  # half a width, as the tangent of 45 degrees is 1
    assert camera.fy == pytest.approx(40 * 4 / 3, rel=0.005)
