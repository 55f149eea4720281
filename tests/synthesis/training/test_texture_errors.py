"""Wrong colours of renderings: gains everywhere and from place to place, and poor textures."""

import numpy as np
import pytest
import torch
from scipy.ndimage import gaussian_filter

from moveit6d.geometry.mesh import Mesh
from moveit6d.rendering.renderer import GBuffer
from moveit6d.rendering.shading import shade_plain
from moveit6d.synthesis.augmentation.backgrounds import procedural_photo
from moveit6d.synthesis.augmentation.random_source import RandomSource
from moveit6d.synthesis.objects.shapes import random_object
from moveit6d.synthesis.training.pairs import PairConfig, PairGenerator
from moveit6d.synthesis.training.texture_errors import (
    PoorTextureConfig,
    TextureColourConfig,
    wrong_colours,
)

Parts = tuple[list[Mesh], list[np.ndarray]]


@pytest.fixture(scope="module")
def generator_parts() -> Parts:
    random = np.random.default_rng(0)
    photos = [procedural_photo(random, (160, 200)) for _ in range(4)]
    return [random_object(random, photos) for _ in range(3)], photos


def source() -> RandomSource:
    return RandomSource(torch.Generator().manual_seed(0))


def a_square(batch: int = 8) -> GBuffer:
    """A square of random colours that faces the camera."""
    albedo = torch.rand(batch, 3, 128, 128, generator=torch.Generator().manual_seed(1))
    mask = torch.zeros(batch, 1, 128, 128)
    mask[:, :, 30:98, 40:88] = 1
    normal = torch.zeros(batch, 3, 128, 128)
    normal[:, 2] = -1
    return GBuffer(albedo * mask, normal * mask, mask, mask)


def poor(**values: object) -> TextureColourConfig:
    """Poor textures in every rendering, and nothing else wrong but what is given."""
    nothing = {
        "blur": (0.01, 0.01), "contrast": (1.0, 1.0), "saturation": (1.0, 1.0), "gain": 0.0,
    }  # fmt: skip
    return TextureColourConfig(
        gain=0.0, poor=PoorTextureConfig(probability=1.0, **{**nothing, **values})
    )


def test_colours_are_wrong_as_a_whole_and_from_place_to_place(generator_parts: Parts) -> None:
    def gains(gain: float, varying_gain: float = 0.0) -> torch.Tensor:
        """What the colours of the same renderings are multiplied by."""
        plain = PairConfig(texture_colour=TextureColourConfig(0.0))
        config = PairConfig(texture_colour=TextureColourConfig(gain, varying_gain))
        generators = [PairGenerator(*generator_parts, c, 0) for c in (plain, config)]
        true, wrong = (g.batch(6).observation.rendering for g in generators)
        bright = (true > 0.2) & (true < 0.6)
        return (wrong / true.clamp_min(0.1))[bright] - 1

    assert gains(0.0).abs().max() == 0
    whole = gains(0.2)
    assert 0.05 < whole.abs().max() <= 0.2 + 1e-5
    assert len(torch.unique(whole.round(decimals=3))) < 80
    wave = gains(0.0, 0.15)
    assert 0.05 < wave.abs().max() <= 0.15 + 1e-5
    assert len(torch.unique(wave.round(decimals=3))) > 80


def test_poor_textures_that_nothing_is_wrong_with_are_the_true_ones() -> None:
    square = a_square()
    assert (wrong_colours(square, poor(), source()) - shade_plain(square)).abs().max() < 1e-5


def test_poor_textures_happen_to_their_share() -> None:
    square = a_square(200)
    config = TextureColourConfig(
        gain=0.0, poor=PoorTextureConfig(0.3, (2.0, 2.0), (1.0, 1.0), (1.0, 1.0), 0.0)
    )
    changed = (wrong_colours(square, config, source()) - shade_plain(square)).abs().amax((1, 2, 3))
    assert 0.2 < (changed > 0.05).float().mean() < 0.4


def test_a_blur_mixes_the_object_s_colours_alone() -> None:
    """SciPy's filter, divided by that of the mask."""
    square = a_square()
    blurred = wrong_colours(square, poor(blur=(2.0, 2.0)), source())
    shaded = shade_plain(square)[0].numpy()
    mask = square.mask[0, 0].numpy()
    expected = np.stack([gaussian_filter(c, 2.0, truncate=3.0) for c in shaded])
    expected *= mask / np.maximum(gaussian_filter(mask, 2.0, truncate=3.0), 1e-3)
    assert np.abs(blurred[0].numpy() - expected).max() < 2e-3
    assert (blurred * (1 - square.mask)).abs().max() == 0


def test_contrast_and_saturation_keep_the_mean_colour_and_the_grey() -> None:
    square = a_square()
    inside = (slice(None), slice(None), slice(30, 98), slice(40, 88))
    true = shade_plain(square)[inside]
    flat = wrong_colours(square, poor(contrast=(0.5, 0.5)), source())[inside]
    assert torch.allclose(flat.mean((2, 3)), true.mean((2, 3)), atol=1e-4)
    assert torch.allclose(flat.std((2, 3)), 0.5 * true.std((2, 3)), atol=1e-3)
    grey = wrong_colours(square, poor(saturation=(0.0, 0.0)), source())[inside]
    assert torch.allclose(grey, true.mean(1, keepdim=True).expand_as(true), atol=1e-4)


def test_the_paper_s_pairs_have_true_textures() -> None:
    assert TextureColourConfig().poor.probability == 0
