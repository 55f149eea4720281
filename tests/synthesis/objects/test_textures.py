"""Textures that are parts of photographs."""

from __future__ import annotations

import numpy as np
import pytest

from moveit6d.synthesis.objects.textures import photo_crop


@pytest.mark.parametrize("size", [(1, 1), (1, 300), (300, 1), (40, 30)])
def test_a_picture_of_any_size_has_parts(size: tuple[int, int]) -> None:
    photo = np.full((*size, 3), 90, np.uint8)
    part = photo_crop(np.random.default_rng(0), [photo], 24, 48)
    assert part.shape == (24, 48, 3) and (part == 90).all()
