"""Configurations are checked when they are made, and errors name the whole path."""

import pytest

from moveit6d.errors import InputError
from moveit6d.synthesis.augmentation.config import AugmentConfig, BlurConfig, MotionBlurConfig
from moveit6d.synthesis.augmentation.hands import HandConfig
from moveit6d.synthesis.settings import check_settings
from moveit6d.synthesis.training.pairs import PairConfig, ZoomConfig
from moveit6d.synthesis.training.views import ViewConfig


def test_defaults_are_valid() -> None:
    check_settings(PairConfig(), "pairs")


def test_a_probability_above_1_is_named_with_its_path() -> None:
    motion = MotionBlurConfig(probability=1.5)
    with pytest.raises(InputError, match=r"^pairs\.augment\.blur\.motion\.probability .* 1\.5\.$"):
        PairConfig(augment=AugmentConfig(blur=BlurConfig(motion=motion)))
    with pytest.raises(InputError, match=r"hands\.card_probability"):
        PairConfig(hands=HandConfig(card_probability=-0.1))


@pytest.mark.parametrize("sigma", [(2.0, 1.0), (0.0, float("nan")), (1.0,)])
def test_ranges_are_two_numbers_in_order(sigma: tuple[float, ...]) -> None:
    with pytest.raises(InputError, match=r"pairs\.augment\.blur\.sigma must be two numbers"):
        PairConfig(augment=AugmentConfig(blur=BlurConfig(sigma=sigma)))  # type: ignore[arg-type]


def test_a_share_lies_between_0_and_1() -> None:
    with pytest.raises(
        InputError, match=r"^pairs\.views\.share must be from 0 to 1, found 1\.5\.$"
    ):
        PairConfig(views=ViewConfig(share=1.5))


def test_ranges_that_are_drawn_from_by_their_logarithms_are_above_0() -> None:
    with pytest.raises(InputError, match=r"^pairs\.distance must be above 0, found \[0\.0, 3\.0\]"):
        PairConfig(distance=(0.0, 3.0))
    with pytest.raises(InputError, match=r"pairs\.zoom\.factor must be above 0"):
        PairConfig(zoom=ZoomConfig(factor=(-1.0, 2.0)))
