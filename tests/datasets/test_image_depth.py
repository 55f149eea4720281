"""Pictures of more than eight bits a channel."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image as Pillow

from moveit6d.datasets.video import (
    read_image,
)

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
