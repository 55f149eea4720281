"""Pose deltas from the start to the truth of training pairs: the paper's five clusters.

Never renders. Paper, section "Training on Synthetic Data", "Data Augmentation".
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...config.ranges import check_range
from ...errors import InputError
from ...typing import Range


@dataclass(frozen=True)
class ClusterConfig:
    """Shares of the clusters and ranges of their absolute pose deltas; signs are random.

    The paper draws each of the five clusters equally often. `near` is ours: small deltas on all six
    axes, as in a tracker's last iterations. All ranges are in action units.

    Args:
        one_small: share of pairs with a small delta on one axis.
        one_large: share of pairs with a large delta on one axis.
        one_large_rest_small: share of pairs with a large delta on one axis, small ones on the rest.
        all_small: share of pairs with small deltas on all axes.
        all_large: share of pairs with large deltas on all axes.
        near: share of pairs with deltas of the `near` ranges on all axes.
        small_xy: small t_x and t_y.
        small_rest: small t_z, r_x, r_y and r_z.
        large_xy: large t_x and t_y.
        large_z: large t_z.
        large_rotation: large r_x, r_y and r_z.
        near_xy: t_x and t_y near the truth.
        near_z: t_z near the truth.
        near_rotation: r_x, r_y and r_z near the truth.
    """

    one_small: float = 0.2
    one_large: float = 0.2
    one_large_rest_small: float = 0.2
    all_small: float = 0.2
    all_large: float = 0.2
    near: float = 0.0
    small_xy: Range = (1.0, 5.0)
    small_rest: Range = (1.0, 4.0)
    large_xy: Range = (5.0, 30.0)
    large_z: Range = (1.0, 15.0)
    large_rotation: Range = (4.0, 20.0)
    near_xy: Range = (0.0, 1.5)
    near_z: Range = (0.0, 3.0)
    near_rotation: Range = (0.0, 4.0)

    def __post_init__(self) -> None:
        check_range(self, "0 or more and finite", *CLUSTERS)
        if not any(self.shares()):
            raise InputError("ClusterConfig: one share at least must be above 0, found none.")

    def shares(self) -> tuple[float, ...]:
        """Shares in the order of `CLUSTERS`."""
        return (
            self.one_small,
            self.one_large,
            self.one_large_rest_small,
            self.all_small,
            self.all_large,
            self.near,
        )

    def ranges(self) -> dict[str, tuple[Range, ...]]:
        """The ranges of the six axes: of small and of large deltas, and of those near the truth."""
        return {
            "small": (self.small_xy,) * 2 + (self.small_rest,) * 4,
            "large": (self.large_xy,) * 2 + (self.large_z,) + (self.large_rotation,) * 3,
            "near": (self.near_xy,) * 2 + (self.near_z,) + (self.near_rotation,) * 3,
        }


CLUSTERS = ("one_small", "one_large", "one_large_rest_small", "all_small", "all_large", "near")


def draw_delta(
    random: np.random.Generator, config: ClusterConfig, cluster: str | None = None
) -> np.ndarray:
    """A pose delta (6,) float64 in action units from a random cluster, or from the named one.

    In the first two clusters each of the 13 actions, stop (zeros) among them, is as likely.

    Examples:
        >>> import numpy as np
        >>> delta = draw_delta(np.random.default_rng(0), ClusterConfig(), "all_small")
        >>> bool((abs(delta[:2]) >= 1).all() and (abs(delta) <= 5).all())
        True
    """
    shares, ranges = np.asarray(config.shares()), config.ranges()
    if cluster is None:
        cluster = CLUSTERS[int(random.choice(len(CLUSTERS), p=shares / shares.sum()))]
    _check_known(cluster)
    small: np.ndarray = _draw(random, 1, ranges["small"])[0]
    large: np.ndarray = _draw(random, 1, ranges["large"])[0]
    if cluster == "all_small":
        return small
    if cluster == "all_large":
        return large
    if cluster == "near":
        near: np.ndarray = _draw(random, 1, ranges["near"])[0]
        return near
    if cluster == "one_large_rest_small":
        axis = int(random.integers(6))
        small[axis] = large[axis]
        return small
    delta = np.zeros(6)
    action = int(random.integers(13))
    if action < 12:
        source = small if cluster == "one_small" else large
        delta[action // 2] = abs(source[action // 2]) * (1 if action % 2 == 0 else -1)
    return delta


def draw_deltas(
    random: np.random.Generator, config: ClusterConfig, number: int, cluster: str | None = None
) -> np.ndarray:
    """Pose deltas (number, 6) float64, each from a random cluster, or all from the named one.

    In the first two clusters each of the 13 actions, stop among them, is as likely.
    """
    shares = np.asarray(config.shares())
    if cluster is not None:
        _check_known(cluster)
    chosen = (
        np.full(number, CLUSTERS.index(cluster))
        if cluster is not None
        else random.choice(len(CLUSTERS), size=number, p=shares / shares.sum())
    )
    small, large, near = (_draw(random, number, ranges) for ranges in config.ranges().values())
    action = random.integers(13, size=number)
    sign = np.where(action % 2 == 0, 1.0, -1.0)[:, None]
    alone = np.arange(6) == action[:, None] // 2  # no axis at all for stop, the last action
    axis = np.arange(6) == random.integers(6, size=number)[:, None]
    found = {
        "one_small": alone * np.abs(small) * sign,
        "one_large": alone * np.abs(large) * sign,
        "one_large_rest_small": np.where(axis, large, small),
        "all_small": small,
        "all_large": large,
        "near": near,
    }
    return np.asarray(np.stack([found[name] for name in CLUSTERS])[chosen, np.arange(number)])


def _check_known(cluster: str) -> None:
    if cluster not in CLUSTERS:
        raise InputError(f"Unknown cluster {cluster!r}; known are {', '.join(CLUSTERS)}.")


def _draw(random: np.random.Generator, number: int, ranges: tuple[Range, ...]) -> np.ndarray:
    low, high = np.array(ranges).T
    shape = (number, len(ranges))
    return np.asarray(random.uniform(low, high, shape) * random.choice([-1.0, 1.0], shape))
