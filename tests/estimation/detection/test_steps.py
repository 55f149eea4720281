"""Steps of a search: to the end, or as far as the time goes."""

from __future__ import annotations

import time

from moveit6d.estimation.detection import Detection
from moveit6d.estimation.detection.steps import Ended, Steps, finish, within


def search(answer: Detection) -> Steps:
    for _ in range(4):
        time.sleep(0.002)
        yield
    return answer


def test_a_search_goes_on_where_the_time_ended() -> None:
    answer = Detection(())
    assert finish(search(answer)) is answer and within(search(answer), None) == Ended(answer)
    steps = search(answer)
    assert [within(steps, 0.0) for _ in range(5)] == [None] * 4 + [Ended(answer)]
    assert within(search(answer), 1.0) is None and within(search(answer), 1e4) == Ended(answer)
