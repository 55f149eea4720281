"""Random camera effects: with the stated probabilities, within the stated ranges."""

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from moveit6d.synthesis.augmentation.camera_effects import (
    colour_jitter,
    motion_blur_lengths,
    random_blur,
    random_digitization,
    random_gaussian_blur,
    random_lens_error,
    random_noise,
    random_object_motion,
    random_radial_blur,
    random_sharpening,
)
from moveit6d.synthesis.augmentation.config import (
    AugmentConfig,
    BlurConfig,
    ColourJitterConfig,
    DownsamplingConfig,
    JpegConfig,
    LensErrorConfig,
    MotionBlurConfig,
    NoiseConfig,
    ObjectMotionConfig,
    SharpeningConfig,
)
from tests.support.pairs import preset, rng

PAPER = preset("paper").augment
REAL = preset("realistic").augment
NO_GAIN = ColourJitterConfig(channel_gain=0.0)


def dots(count: int, size: int = 25) -> Tensor:
    """A white dot in the middle of black pictures of one channel."""
    picture = torch.zeros(count, 1, size, size)
    picture[:, :, size // 2, size // 2] = 1
    return picture


def changed(before: Tensor, after: Tensor) -> Tensor:
    return ((before - after).abs().flatten(1).amax(1) > 1e-4).float()


def widths(picture: Tensor) -> tuple[Tensor, Tensor]:
    """Standard deviations of each picture's brightness along its longest and shortest direction."""
    line = torch.arange(picture.shape[-1]).float() - picture.shape[-1] // 2
    y, x = torch.meshgrid(line, line, indexing="ij")
    weight = picture[:, 0]
    moments = [(weight * m).sum((1, 2)) for m in (x * x, x * y, x * y, y * y)]
    spread = torch.linalg.eigvalsh(torch.stack(moments, -1).reshape(-1, 2, 2))
    return spread[:, 1].clamp_min(0).sqrt(), spread[:, 0].clamp_min(0).sqrt()


def test_the_paper_s_motion_blur_is_in_three_quarters_with_its_sigma() -> None:
    lengths = motion_blur_lengths(4000, PAPER.blur.motion, rng())
    assert (lengths / 128).square().mean().sqrt() == pytest.approx(0.05, rel=0.05)
    before = dots(800)
    after = random_blur(before, PAPER.blur, rng())
    assert after.flatten(1).sum(1) == pytest.approx(torch.ones(800), abs=1e-4)
    # Motion of under a pixel or so leaves a dot as it is.
    assert changed(before, after).mean() == pytest.approx(0.75, abs=0.07)
    along, across = widths(after)
    assert across.max() < 0.5 and along.max() > 2.5, "blurred along one direction only"


def test_our_blur_is_defocus_and_in_half_of_it_motion() -> None:
    motion = MotionBlurConfig(probability=0.5, length=(8.0, 8.0))
    config = BlurConfig(probability=1.0, sigma=(0.8, 1.4), motion=motion)
    along, across = widths(random_blur(dots(600), config, rng()))
    assert across.min() > 0.75 and across.max() < 1.45
    moved = (along > across + 0.3).float()
    assert moved.mean() == pytest.approx(0.5, abs=0.07)
    expected = (across**2 + 64 / 12).sqrt()[moved > 0]
    assert (along[moved > 0] / expected).mean() == pytest.approx(1.0, abs=0.1)


def test_a_part_of_the_objects_moves_in_one_direction() -> None:
    config = ObjectMotionConfig(probability=0.5, length=(10.0, 10.0))
    before = dots(600).expand(-1, 4, -1, -1)
    after = random_object_motion(before, config, rng())
    assert after.flatten(2).sum(2) == pytest.approx(torch.ones(600, 4), abs=1e-4)
    moved = changed(before, after)
    assert moved.mean() == pytest.approx(0.5, abs=0.07)
    along, across = widths(after[moved > 0])
    # A uniform motion of 10 pixels, cut off at 6 to either side.
    assert across.max() < 0.8 and along.min() > 2.3
    assert random_object_motion(before, ObjectMotionConfig(), rng()) is before


def test_radial_blur_is_in_a_quarter_and_leaves_the_middle_sharp() -> None:
    rings = torch.rand(400, 1, 33, 33, generator=torch.Generator().manual_seed(0))
    after = random_radial_blur(rings, replace(PAPER.radial_blur, zoom_sigma=0.3), rng())
    was = changed(rings, after)
    assert was.mean() == pytest.approx(0.25, abs=0.06)
    off = (after - rings)[was > 0].abs().mean((0, 1))
    assert off[16, 16] < 0.3 * off[2, 2] and off[16, 16] < 0.3 * off[30, 16]


def colours(config: ColourJitterConfig, count: int = 1500) -> Tensor:
    """A flat picture of one colour after `colour_jitter`, one value a channel (count, 3)."""
    flat = torch.tensor([0.4, 0.5, 0.6])[None, :, None, None].expand(count, 3, 2, 2)
    return colour_jitter(flat, config, rng())[..., 0, 0]


@pytest.mark.parametrize(
    ("config", "low", "high"), [(PAPER.colour, 0.95, 1.25), (NO_GAIN, 0.7, 1.3)]
)
def test_brightness_has_the_stated_range(
    config: ColourJitterConfig, low: float, high: float
) -> None:
    config = replace(config, contrast=(1.0, 1.0), saturation=(1.0, 1.0))
    factor = colours(config)[:, 1] / 0.5
    assert low - 1e-4 <= factor.min() < low + 0.01 and high - 0.01 < factor.max() <= high + 1e-4


def test_contrast_and_saturation_have_the_paper_s_range() -> None:
    still = replace(PAPER.colour, brightness=(1.0, 1.0), contrast=(1.0, 1.0))
    spread = (colours(still)[:, 2] - colours(still)[:, 0]) / 0.2
    assert 0.949 <= spread.min() < 0.96 and 1.24 < spread.max() <= 1.251
    halves = torch.full((1500, 3, 2, 2), 0.4)
    halves[..., 1] = 0.6
    after = colour_jitter(halves, replace(still, contrast=PAPER.colour.contrast), rng())
    spread = (after[..., 1] - after[..., 0])[:, 0, 0] / 0.2
    assert 0.949 <= spread.min() < 0.96 and 1.24 < spread.max() <= 1.251


def test_noise_and_white_balance_can_be_left_out_and_have_their_ranges() -> None:
    still = replace(NO_GAIN, brightness=(1.0, 1.0), contrast=(1.0, 1.0), saturation=(1.0, 1.0))
    tinted = colours(replace(still, channel_gain=0.1))[:, 1] / 0.5
    assert 0.9 <= tinted.min() < 0.91 and 1.09 < tinted.max() <= 1.1 + 1e-5
    assert torch.allclose(colours(still), torch.tensor([0.4, 0.5, 0.6]))
    flat = torch.full((200, 3, 20, 20), 0.5)
    assert torch.equal(random_noise(flat, PAPER.noise, rng()), flat)
    spread = random_noise(flat, NoiseConfig(sigma=(0.01, 0.03)), rng()).flatten(1).std(1)
    assert spread.min() > 0.009 and spread.max() < 0.032


def test_lens_errors_displace_by_what_is_stated_without_shift_or_scale() -> None:
    line = torch.arange(48).float()
    y, x = torch.meshgrid(line, line, indexing="ij")
    places = torch.stack([x, y])[None].repeat(300, 1, 1, 1)  # a picture of its own coordinates
    config = LensErrorConfig(probability=0.3, displacement=(0.5, 1.5))
    moved = random_lens_error(places, config, rng()) - places
    moved = moved[..., 2:-2, 2:-2]  # the border repeats pixels
    size = moved.norm(dim=1).flatten(1).amax(1)
    displaced = size > 1e-3
    assert displaced.float().mean() == pytest.approx(0.3, abs=0.08)
    assert size.max() <= 1.5 and size[displaced].mean() > 0.6
    inside = places[..., 2:-2, 2:-2] - 23.5
    shift = moved.mean((2, 3))
    scale = (moved * inside).sum((1, 2, 3)) / inside.square().sum((1, 2, 3))
    # The field itself has neither; two pixels less on each side leave a trace of them.
    assert shift.abs().max() < 0.1 and (scale.abs() * 24).max() < 0.15


def test_backgrounds_are_out_of_focus_as_often_and_as_much_as_stated() -> None:
    before = dots(400).expand(-1, 3, -1, -1)
    after = random_gaussian_blur(before, REAL.background_blur, rng())
    was = changed(before, after)
    assert was.mean() == pytest.approx(REAL.background_blur.probability, abs=0.07)
    along, across = widths(after[was > 0])
    assert across.min() > 0.4 and along.max() < 3.6
    never = AugmentConfig().background_blur
    assert torch.equal(random_gaussian_blur(before, never, rng()), before)


ONE = torch.ones(1, 1, 1, 1)  # colours that are amounts of light already
NO_JPEG = JpegConfig(probability=0.0)


def test_low_resolution_reaches_objects_of_under_40_pixels() -> None:
    fine = (torch.arange(128) % 2).float().expand(160, 1, 128, 128).contiguous()
    config, gamma = replace(REAL.downsampling, probability=1.0), ONE.expand(160, 1, 1, 1)
    coarse = random_digitization(fine, gamma, config, NO_JPEG, rng(), groups=80)
    kept = coarse.std(-1)[:, 0, 0]
    # A fine grating vanishes where there are fewer pixels than it needs.
    assert (kept < 0.1).float().mean() > 0.5
    assert REAL.downsampling.scale[0] * 128 / 1.4 < 40 < REAL.downsampling.scale[1] * 128 / 1.4
    config = replace(config, probability=0.45)
    rare = random_digitization(fine, gamma, config, NO_JPEG, rng(), groups=160)
    assert changed(fine, rare).mean() == pytest.approx(0.45, abs=0.1)


def test_jpeg_and_sharpening_happen_as_often_as_stated() -> None:
    noise = torch.rand(90, 3, 16, 16, generator=torch.Generator().manual_seed(0))
    jpeg, never = JpegConfig(probability=0.35, quality=(35.0, 60.0)), DownsamplingConfig(0.0)
    compressed = random_digitization(noise, ONE.expand(90, 1, 1, 1), never, jpeg, rng(), 90)
    assert changed(noise, compressed).mean() == pytest.approx(0.35, abs=0.13)
    sharp = random_sharpening(noise, SharpeningConfig(probability=0.3), rng())
    was = changed(noise, sharp)
    assert was.mean() == pytest.approx(0.3, abs=0.13)
    assert sharp[was > 0].std() > noise.std()


def test_pixels_of_a_coarser_sensor_add_up_light() -> None:
    """Black and white stripes too fine for the sensor become the grey that holds half the light."""
    stripes = (torch.arange(128) % 2).float().expand(4, 3, 128, 128).contiguous()
    config = DownsamplingConfig(probability=1.0, scale=(0.25, 0.25))
    gamma = ONE.expand(4, 1, 1, 1) * 2.2
    seen = random_digitization(stripes, gamma, config, NO_JPEG, rng())
    assert seen[..., 32:96, 32:96].mean() == pytest.approx(0.5 ** (1 / 2.2), abs=0.01)
