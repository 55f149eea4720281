"""The five clusters: many samples, shares and ranges as the paper states them."""

import numpy as np
import pytest

from moveit6d.errors import InputError
from moveit6d.synthesis.training.clusters import ClusterConfig, draw_delta


def draw(cluster: str | None, number: int = 4000) -> np.ndarray:
    random = np.random.default_rng(0)
    return np.stack([draw_delta(random, ClusterConfig(), cluster) for _ in range(number)])


SMALL = np.array([[1, 5], [1, 5], [1, 4], [1, 4], [1, 4], [1, 4]])
LARGE = np.array([[5, 30], [5, 30], [1, 15], [4, 20], [4, 20], [4, 20]])


@pytest.mark.parametrize(("cluster", "ranges"), [("all_small", SMALL), ("all_large", LARGE)])
def test_all_axes_stay_in_their_ranges_with_random_signs(cluster: str, ranges: np.ndarray) -> None:
    delta = draw(cluster)
    size = np.abs(delta)
    assert (size >= ranges[:, 0]).all() and (size <= ranges[:, 1]).all()
    assert np.allclose(size.mean(0), ranges.mean(1), rtol=0.03)
    assert np.abs((delta > 0).mean(0) - 0.5).max() < 0.03


@pytest.mark.parametrize(("cluster", "ranges"), [("one_small", SMALL), ("one_large", LARGE)])
def test_single_moves_are_each_of_the_13_actions_as_often(cluster: str, ranges: np.ndarray) -> None:
    delta = draw(cluster, 13_000)
    moved = (delta != 0).sum(1)
    assert set(moved) == {0, 1}
    shares = [(delta[:, axis] * sign > 0).mean() for axis in range(6) for sign in (1, -1)]
    assert np.abs(np.array([*shares, (moved == 0).mean()]) - 1 / 13).max() < 0.01
    for axis in range(6):
        size = np.abs(delta[delta[:, axis] != 0, axis])
        assert ranges[axis, 0] <= size.min() and size.max() <= ranges[axis, 1]


def test_one_large_rest_small() -> None:
    size = np.abs(draw("one_large_rest_small"))
    beyond = size > SMALL[:, 1]
    assert (beyond.sum(1) <= 1).all() and (size >= 1).all()


def test_the_paper_s_shares_are_a_fifth_each() -> None:
    assert ClusterConfig().shares() == (0.2, 0.2, 0.2, 0.2, 0.2, 0.0)


def test_unknown_clusters_are_named() -> None:
    with pytest.raises(InputError, match="'huge'"):
        draw("huge", 1)


@pytest.mark.parametrize("share", [-0.1, float("nan"), float("inf")])
def test_shares_that_are_none_are_refused(share: float) -> None:
    with pytest.raises(InputError, match=r"ClusterConfig: all_small must be 0 or more and finite"):
        ClusterConfig(all_small=share)


def test_a_choice_among_no_clusters_is_refused() -> None:
    with pytest.raises(InputError, match="ClusterConfig: one share at least must be above 0"):
        ClusterConfig(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
