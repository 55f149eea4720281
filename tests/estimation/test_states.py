"""States: hysteresis, loss after so many frames, and the log of events."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from moveit6d.config import StateConfig
from moveit6d.datasets.pose_files import PoseRow
from moveit6d.estimation.states import StateMachine, TrackingState, probability_of
from moveit6d.evaluation.run_tracker import TrackSummary

CONFIG = StateConfig(confirmed=0.6, doubted=0.4, rejected=0.2, frames_to_lose=3, frames_to_find=2)


def states(*probabilities: float, begin: TrackingState = TrackingState.TRACKING) -> list[str]:
    machine = StateMachine(CONFIG, begin)
    return [str(machine.update(p)) for p in probabilities]


def test_doubt_between_the_limits_changes_nothing() -> None:
    assert states(0.9, 0.5, 0.45) == ["tracking"] * 3
    assert states(0.9, 0.3, 0.5, 0.9) == ["tracking", "uncertain", "uncertain", "uncertain"]
    assert states(0.3, 0.9, 0.9) == ["uncertain", "uncertain", "tracking"]


def test_an_object_is_lost_after_so_many_frames_in_a_row() -> None:
    assert states(0.1, 0.1, 0.1) == ["uncertain", "uncertain", "lost"]
    assert states(0.1, 0.1, 0.3, 0.1, 0.1) == ["uncertain"] * 5


def test_a_lost_object_comes_back_by_confirmation() -> None:
    lost = TrackingState.LOST
    assert states(0.1, 0.3, 0.9, 0.9, begin=lost) == ["lost", "uncertain", "uncertain", "tracking"]
    assert states(0.1, 0.19, begin=lost) == ["lost", "lost"]


@given(st.lists(st.floats(0, 1), min_size=1, max_size=40))
def test_events_tell_the_states(probabilities: list[float]) -> None:
    found = states(*probabilities)
    summary = TrackSummary()
    for number, state in enumerate(found):
        summary.add_row(PoseRow(number, state=state))
    told = []
    for event in summary.events:
        assert isinstance(event["last"], int) and isinstance(event["first"], int)
        told += [event["state"]] * (event["last"] - event["first"] + 1)
    assert told == found


@given(st.floats(0, 1), st.floats(0, 1))
def test_both_kinds_of_evidence_count(confidence: float, agreement: float) -> None:
    config = StateConfig()
    p = probability_of(config, confidence, agreement)
    assert 0 < p < 1
    assert probability_of(config, 1.0, agreement) >= p <= probability_of(config, confidence, 1.0)


def test_confidence_alone_does_not_make_a_track() -> None:
    # A network that is for something whose contour fits nowhere, or well.
    assert probability_of(StateConfig(), 0.7, 0.0) < StateConfig().confirmed
    assert probability_of(StateConfig(), 0.7, 0.5) > StateConfig().confirmed


def test_of_a_mesh_without_colours_the_confidence_says_less() -> None:
    config = StateConfig()
    for confidence in (0.6, 0.75, 0.9):
        plain = probability_of(config, confidence, 0.45, coloured=False)
        assert plain < probability_of(config, confidence, 0.45)
    # Such poses were taken for right, of which a third are.
    assert probability_of(config, 0.72, 0.4, coloured=False) < config.doubted
