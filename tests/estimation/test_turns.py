"""Lost objects take turns, and share the time that searches may take of a frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import pytest

from moveit6d.config import RecoveryConfig
from moveit6d.estimation.turns import SearchTurns


@dataclass
class Object:
    """What is asked of a `Supervisor`."""

    lost: bool = True
    searching: bool = False


def numbers(turns: SearchTurns, objects: Sequence[Any]) -> list[int]:
    return [number for number, _ in turns.of_frame(objects)]


def test_without_a_limit_all_lost_objects_are_looked_for_in_their_order() -> None:
    turns = SearchTurns(RecoveryConfig(), [[], [2], [1]])
    objects = [Object(), Object(searching=True), Object(), Object(lost=False)]
    turns.same = [[], [2], [1], []]
    assert [numbers(turns, objects) for _ in range(2)] == [[0, 1, 2], [0, 1, 2]]


def test_with_a_limit_each_comes_first_in_its_turn() -> None:
    turns = SearchTurns(RecoveryConfig(max_milliseconds=5.0), [[], [], []])
    objects = [Object(), Object(), Object()]
    assert [numbers(turns, objects) for _ in range(3)] == [[1, 2, 0], [2, 0, 1], [0, 1, 2]]
    assert numbers(turns, [Object(lost=False)] * 3) == []


def test_of_instances_of_one_mesh_one_is_looked_for_at_a_time() -> None:
    turns = SearchTurns(RecoveryConfig(max_milliseconds=5.0), [[1], [0], []])
    assert 1 not in numbers(turns, [Object(searching=True), Object(), Object()])
    begun = [Object(), Object(), Object()]
    asked = []
    for number, _ in turns.of_frame(begun):
        asked.append(number)
        begun[number].searching = True
    assert len({0, 1} & set(asked)) == 1 and 2 in asked


def test_who_comes_first_has_spent_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter([10.0, 10.002, 10.009])
    monkeypatch.setattr("time.perf_counter", lambda: next(clock))
    turns = SearchTurns(RecoveryConfig(), [[], []])
    spent = [time for _, time in turns.of_frame([Object(), Object()])]
    assert spent == pytest.approx([0.0, 2.0])
