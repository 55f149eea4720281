"""The sensor: noise of the stated variance, colours by their formulas, JPEG as Pillow's."""

import io

import numpy as np
import pytest
import torch
from PIL import Image

from moveit6d.synthesis.imaging.sensor import (
    add_noise,
    adjust_colour,
    compress_jpeg,
    resize,
    sharpen,
    to_bytes,
)


def test_read_and_shot_noise_add_up_as_variances() -> None:
    noise = torch.randn(1, 1, 200, 200, generator=torch.Generator().manual_seed(0))
    for level in (0.0, 0.25, 1.0):
        seen = add_noise(torch.full_like(noise, level), noise, torch.tensor(0.01), 0.03)
        assert float(seen.std()) == pytest.approx((0.01**2 + level * 0.03**2) ** 0.5, rel=0.02)
    assert torch.equal(add_noise(noise, noise, 0.1), noise + noise * 0.1)


def test_larger_pixels_hold_the_mean_of_the_smaller_ones() -> None:
    stripes = (torch.arange(64) % 2).float().expand(1, 3, 64, 64)
    assert resize(stripes, 16, 16)[..., 4:12].sub(0.5).abs().max() < 0.01


def test_gain_contrast_and_saturation() -> None:
    grey = torch.full((1, 3, 4, 4), 0.5)
    gain = torch.tensor([1.1, 1.0, 0.9])[None, :, None, None]
    one = torch.ones(1)
    assert torch.allclose(adjust_colour(grey, gain, one, one), grey * gain, atol=1e-6)
    flat = adjust_colour(grey * gain, torch.ones(1, 3, 1, 1), one, torch.zeros(1))
    assert (flat.amax(1) - flat.amin(1)).max() < 1e-6, "without saturation all channels agree"


def test_sharpening_leaves_flat_areas_and_overshoots_at_edges() -> None:
    step = torch.full((1, 1, 8, 8), 0.25)
    step[..., 4:] = 0.75
    seen = sharpen(step, torch.ones(1, 1, 1, 1))
    assert torch.allclose(seen[..., :2], step[..., :2], atol=1e-6)
    assert seen[..., 3].max() < 0.25 and seen[..., 4].min() > 0.75


def test_jpeg_loses_about_what_pillow_s_does() -> None:
    random = np.random.default_rng(0)
    coarse = Image.fromarray(random.integers(0, 256, (8, 8, 3), np.uint8))
    picture = np.asarray(coarse.resize((64, 64), Image.Resampling.BICUBIC))
    buffer = io.BytesIO()
    Image.fromarray(picture).save(buffer, "JPEG", quality=30)
    image = torch.from_numpy(picture.copy()).permute(2, 0, 1)[None].float() / 255
    ours = to_bytes(compress_jpeg(image, torch.tensor([30.0])))[0].permute(1, 2, 0).numpy()
    errors = [
        np.abs(one.astype(float) - picture).mean() for one in (np.asarray(Image.open(buffer)), ours)
    ]
    assert 1 < errors[0] < 20 and errors[1] == pytest.approx(errors[0], rel=0.3)


def test_bytes_are_rounded_and_clamped() -> None:
    assert to_bytes(torch.tensor([-0.1, 0.5, 1.2])).tolist() == [0, 128, 255]
