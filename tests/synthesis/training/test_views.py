"""Views for descriptors: the object in the middle, the positive template first."""

from dataclasses import replace

import pytest
import torch

from moveit6d.synthesis.training.pairs import PairConfig, PairGenerator
from moveit6d.synthesis.training.views import ViewConfig
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
