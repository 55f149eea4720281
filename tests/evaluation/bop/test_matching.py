"""BOP's matching on cases done by hand, and on random ones with a plain rewrite of the rules."""

from __future__ import annotations

import torch
from hypothesis import given
from hypothesis import strategies as st

from moveit6d.evaluation.bop.matching import best_scored, match, matched_counts, most_visible

INF = float("inf")


def errors(rows: list[list[float]]) -> torch.Tensor:
    return torch.tensor(rows, dtype=torch.float64)


def test_the_better_score_chooses_first() -> None:
    # Both are nearest to the first true pose; the second estimate must take the other one.
    assert match(errors([[0.1, 0.2], [0.05, 0.3]]), 0.5) == [0, 1]
    assert match(errors([[0.1, 0.2], [0.05, 0.6]]), 0.5) == [0, None]
    # A greedy choice is not the best assignment, and BOP's is greedy.
    assert match(errors([[0.1, 0.11], [0.05, 0.9]]), 0.5) == [0, None]


def test_the_limit_itself_does_not_match_and_ties_go_to_the_first() -> None:
    assert match(errors([[0.5]]), 0.5) == [None]
    assert match(errors([[0.2, 0.2]]), 0.5) == [0]
    assert match(errors([[INF]]), INF) == [None]
    assert match(torch.zeros(2, 0), 0.5) == [None, None]


def test_counts_by_kind_and_limit() -> None:
    assert matched_counts(errors([[0.1]]), [0.05, 0.1, 0.2]).tolist() == [[0, 0, 1]]
    two = torch.stack([errors([[0.1, 0.9], [0.9, 0.3]]), errors([[0.9] * 2] * 2)], -1)
    assert matched_counts(two, [0.2, 0.5]).tolist() == [[1, 2], [0, 0]]
    assert matched_counts(torch.zeros(0, 3, 2), [0.2]).tolist() == [[0], [0]]
    assert matched_counts(torch.zeros(3, 0), [0.2]).tolist() == [[0]]


def test_the_most_visible_count_and_ties_keep_the_order_of_the_file() -> None:
    assert most_visible([0.2, 0.9, 0.2, 0.5], 3) == [1, 3, 0]
    assert most_visible([0.2], 3) == [0]
    assert best_scored([0.5, 0.7, 0.7], 2) == [1, 2]


def by_the_toolkit(rows: list[list[float]], limit: float) -> list[int | None]:
    """pose_matching.match_poses in other words."""
    used: list[int] = []
    out: list[int | None] = []
    for row in rows:
        best, least = None, limit
        for k, error in enumerate(row):
            if k not in used and error < least:
                best, least = k, error
        used += [best] if best is not None else []
        out.append(best)
    return out


ROWS = st.integers(1, 4).flatmap(
    lambda width: st.lists(
        st.lists(st.sampled_from([0.1, 0.2, 0.3, 0.4, INF]), min_size=width, max_size=width),
        min_size=1,
        max_size=5,
    )
)


@given(ROWS, st.sampled_from([0.1, 0.25, 0.4, 1.0]))
def test_matching_follows_the_toolkit(rows: list[list[float]], limit: float) -> None:
    expected = by_the_toolkit(rows, limit)
    assert match(errors(rows), limit) == expected
    found = sum(k is not None for k in expected)
    assert matched_counts(errors(rows), [limit]).tolist() == [[found]]
