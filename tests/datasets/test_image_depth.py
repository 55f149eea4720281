"""Pictures of more than eight bits a channel."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image as Pillow

from moveit6d.datasets.video import ImageList, read_image

RED = np.full((48, 64, 3), (200, 30, 30), np.uint8)


def test_grey_and_deep_images_become_rgb_bytes(tmp_path: Path) -> None:
    ramp = np.arange(48 * 64).reshape(48, 64)
    Pillow.fromarray((ramp % 256).astype(np.uint8)).save(tmp_path / "grey.png")
    np.testing.assert_array_equal(read_image(tmp_path / "grey.png")[..., 2], ramp % 256)
    Pillow.fromarray((ramp * 20).astype(np.uint16)).save(tmp_path / "deep.png")
    deep = read_image(tmp_path / "deep.png")
    assert deep.dtype == np.uint8 and deep.shape == (48, 64, 3)
    np.testing.assert_allclose(deep[..., 1], ramp * 20 / 257, atol=1)
    alpha = np.dstack([RED, np.full((48, 64), 7, np.uint8)])
    Pillow.fromarray(alpha).save(tmp_path / "alpha.png")
    np.testing.assert_array_equal(read_image(tmp_path / "alpha.png"), RED)


@pytest.mark.parametrize("bits", [10, 12, 14, 16])
@pytest.mark.parametrize("color", [False, True])
def test_cameras_fill_fewer_than_16_bits(tmp_path: Path, bits: int, color: bool) -> None:
    import cv2

    ramp = np.linspace(0, 2**bits - 1, 48 * 64).reshape(48, 64).astype(np.uint16)
    values = np.dstack([ramp // 2, ramp // 3, ramp]) if color else ramp
    cv2.imwrite(str(tmp_path / "deep.png"), values)
    expected = (values[..., ::-1] if color else ramp[..., None]) * (255 / (2**bits - 1))
    np.testing.assert_allclose(read_image(tmp_path / "deep.png"), expected + [0] * 3, atol=1)


def test_one_video_keeps_its_bits_when_it_gets_dark(tmp_path: Path) -> None:
    shares = [0.05] * 3 + [0.5] * 14 + [0.01] * 3
    paths = []
    for number, share in enumerate(shares):
        paths.append(tmp_path / f"{number}.png")
        Pillow.fromarray(np.full((4, 4), int(share * 65535), np.uint16)).save(paths[-1])
    frames = ImageList(paths)
    for _ in range(2):  # dark ones at the start are known from those that are looked at
        levels = [int(frame.image.max()) for frame in frames if frame.image is not None]
        np.testing.assert_allclose(levels, np.array(shares) * 255, atol=1)
    assert int(read_image(paths[-1]).max()) > 100, "which alone would be a bright one of 10 bits"
