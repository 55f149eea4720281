"""Views for descriptors: the object in the middle, the positive template first."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from moveit6d.geometry.crop import Crop
from moveit6d.synthesis.augmentation.config import (
    AugmentConfig,
    BlurConfig,
    CastShadowConfig,
    ClutterConfig,
    DownsamplingConfig,
    ImageBorderConfig,
    JpegConfig,
    NoiseConfig,
    OcclusionConfig,
)
from moveit6d.synthesis.augmentation.lights import LightConfig
from moveit6d.synthesis.training.pairs import PairConfig, PairGenerator
from moveit6d.synthesis.training.views import ViewConfig
from tests.support.meshes import l_shape
from tests.support.pairs import objects, photos

EXACT = ViewConfig(
    share=0.5, other_views=3, positive_rotation=0.0, shift=0.0, size=0.0, distance=(5.0, 5.0)
)


def drawn(views: ViewConfig, absent: float = 0.0, size: int = 12):  # type: ignore[no-untyped-def]
    config = replace(PairConfig(), views=views, distance=(5.0, 5.0), absent_probability=absent)
    return PairGenerator(list(objects()), list(photos()), config, 3).batch(size, "all_large")


def test_the_first_template_shows_the_object_where_it_is() -> None:
    views = drawn(EXACT).views
    assert views is not None and views.image.shape == (6, 3, 128, 128)
    assert views.templates.shape == (6, 4, 3, 128, 128) and views.masks.shape == (6, 4, 1, 128, 128)
    # The picture around the truth, unlit and uncovered, has the template's own outline.
    middle = views.masks[:, 0, 0].flatten(1).float()
    line = torch.arange(128).float() - 63.5
    x, y = line.expand(128, 128).flatten(), line[:, None].expand(128, 128).flatten()
    centre = torch.stack([(middle * x).sum(1), (middle * y).sum(1)], 1) / middle.sum(1)[:, None]
    assert centre.abs().max() < 25
    assert (views.positive[:, 0] == 1).all()
    assert views.visible.min() >= 0 and views.visible.max() <= 1.001


def test_templates_are_positive_up_to_an_angle() -> None:
    views = drawn(replace(EXACT, other_rotation=(60.0, 90.0))).views
    assert views is not None
    plain = [mesh.symmetries.is_trivial for mesh in objects()]
    if all(plain):
        assert (views.positive[:, 1:3] == 0).all()


def test_an_absent_object_is_invisible() -> None:
    views = drawn(EXACT, absent=1.0).views
    assert views is not None and views.visible.max() == 0


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_the_share_of_a_batch(share: float) -> None:
    count = ViewConfig(share=share).count(20)
    assert count == {0.0: 0, 0.3: 6, 1.0: 20}[share]


@pytest.mark.parametrize("crop", ["look_at", "axis_parallel"])
def test_the_object_is_cut_out_as_templates_show_it(crop: Crop) -> None:
    """White objects in front of nothing have the outline of the template near the true view."""
    none = AugmentConfig(
        occlusion=OcclusionConfig(probability=0.0), clutter=ClutterConfig(probability=0.0),
        cast_shadow=CastShadowConfig(probability=0.0), blur=BlurConfig(probability=0.0),
        downsampling=DownsamplingConfig(probability=0.0), jpeg=JpegConfig(probability=0.0),
        image_border=ImageBorderConfig(probability=0.0), noise=NoiseConfig((0.0, 0.0)),
    )  # fmt: skip
    config = PairConfig(
        views=replace(EXACT, share=1.0), distance=(5.0, 5.0), crop=crop, augment=none,
        lights=LightConfig(unlit_probability=1.0),
    )  # fmt: skip
    white, black = l_shape(), [np.zeros((150, 150, 3), np.uint8)]
    white = replace(white, vertex_colors=np.full_like(white.vertex_colors, 255))
    generator = PairGenerator([white], black, config, 0)
    still = torch.zeros(16, 6, dtype=torch.float64)
    views = generator.compose(torch.zeros(16, dtype=torch.long), still).views
    assert views is not None
    cut, template = views.image.amax(1) > 0.3, views.masks[:, 0, 0] > 0.5
    shared, either = ((cut & template).flatten(1), (cut | template).flatten(1))
    overlap = shared.sum(1) / either.sum(1)
    assert overlap.mean() > 0.92
