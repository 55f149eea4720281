"""How far from the truth the training starts lie: the paper's five clusters of pose seeds.

Never renders. Paper, section "Training on Synthetic Data", "Data Augmentation".
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...errors import InputError

Range = tuple[float, float]


@dataclass(frozen=True)
class ClusterConfig:
    """Shares of the clusters and their ranges of the absolute values; signs are random.

    The paper draws each of the five clusters equally often. `near` is ours: all six axes within
    `near_range`, where a tracker spends its last iterations.
    """

    one_small: float = 0.2
    one_large: float = 0.2
    one_large_rest_small: float = 0.2
    all_small: float = 0.2
    all_large: float = 0.2
    near: float = 0.0
    small_shift: Range = (1.0, 5.0)  # t_x, t_y
    small_rest: Range = (1.0, 4.0)  # t_z, r_x, r_y, r_z
    large_shift: Range = (5.0, 30.0)
    large_size: Range = (1.0, 15.0)  # t_z
    large_turn: Range = (4.0, 20.0)
    near_shift: Range = (0.0, 1.5)
    near_size: Range = (0.0, 3.0)
    near_turn: Range = (0.0, 4.0)

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


CLUSTERS = ("one_small", "one_large", "one_large_rest_small", "all_small", "all_large", "near")


def draw_delta(
    random: np.random.Generator, config: ClusterConfig, cluster: str | None = None
) -> np.ndarray:
    """Counts (6,) float64 from a random cluster, or from the named one.

    In the first two clusters each of the 13 actions, stop (no counts) among them, is as likely.
    """
    shares = np.asarray(config.shares())
    if cluster is None:
        cluster = CLUSTERS[int(random.choice(len(CLUSTERS), p=shares / shares.sum()))]
    small = _draw(random, (config.small_shift,) * 2 + (config.small_rest,) * 4)
    large = _draw(
        random, (config.large_shift,) * 2 + (config.large_size,) + (config.large_turn,) * 3
    )
    if cluster == "all_small":
        return small
    if cluster == "all_large":
        return large
    if cluster == "near":
        return _draw(
            random, (config.near_shift,) * 2 + (config.near_size,) + (config.near_turn,) * 3
        )
    if cluster == "one_large_rest_small":
        axis = int(random.integers(6))
        small[axis] = large[axis]
        return small
    if cluster in ("one_small", "one_large"):
        delta = np.zeros(6)
        action = int(random.integers(13))
        if action < 12:
            source = small if cluster == "one_small" else large
            delta[action // 2] = abs(source[action // 2]) * (1 if action % 2 == 0 else -1)
        return delta
    raise InputError(f"Unknown cluster {cluster!r}; known are {', '.join(CLUSTERS)}.")


def draw_deltas(
    random: np.random.Generator, config: ClusterConfig, number: int, cluster: str | None = None
) -> np.ndarray:
    """Pose deltas (number, 6) float64, each from a random cluster, or all from the named one.

    In the first two clusters each of the 13 actions, stop among them, is as likely.
    """
    shares = np.asarray(config.shares())
    if cluster is not None and cluster not in CLUSTERS:
        raise InputError(f"Unknown cluster {cluster!r}; known are {', '.join(CLUSTERS)}.")
    chosen = (
        np.full(number, CLUSTERS.index(cluster))
        if cluster is not None
        else random.choice(len(CLUSTERS), size=number, p=shares / shares.sum())
    )
    small = _draw_many(random, number, (config.small_shift,) * 2 + (config.small_rest,) * 4)
    large = _draw_many(
        random, number, (config.large_shift,) * 2 + (config.large_size,) + (config.large_turn,) * 3
    )
    near = _draw_many(
        random, number, (config.near_shift,) * 2 + (config.near_size,) + (config.near_turn,) * 3
    )
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


def _draw(random: np.random.Generator, ranges: tuple[Range, ...]) -> np.ndarray:
    low, high = np.array(ranges).T
    return np.asarray(random.uniform(low, high) * random.choice([-1.0, 1.0], len(ranges)))


def _draw_many(random: np.random.Generator, number: int, ranges: tuple[Range, ...]) -> np.ndarray:
    low, high = np.array(ranges).T
    shape = (number, len(ranges))
    return np.asarray(random.uniform(low, high, shape) * random.choice([-1.0, 1.0], shape))
