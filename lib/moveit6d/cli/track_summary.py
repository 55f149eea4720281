"""What `moveit6d track` says of a track: summary.json, and the lines at its end.

Never tracks.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import islice
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from .common import NOT_FOUND, Setting, given, versions, weights_facts
from .journal import CONTENT, Journal
from .narrowing import advice

if TYPE_CHECKING:
    from ..evaluation.run_tracker import TrackSummary
    from .resuming import Earlier


def track_record(earlier: Earlier) -> TrackSummary:
    """What is gathered for the summary of an object; it knows the track of before."""
    from ..evaluation.run_tracker import KEPT_FAILURES, TrackSummary

    record = TrackSummary()
    for frame, text in islice(earlier.failures.items(), KEPT_FAILURES):
        record.failures.append({"frame": frame, "error": text})
    for row in earlier.rows:
        record.add_row(row)
    return record


@contextmanager
def track_summary(
    records: Sequence[TrackSummary],
    names: Sequence[str],
    args: argparse.Namespace,
    setting: Setting,
    journal: Journal,
    found: Mapping[str, Any],
) -> Iterator[None]:
    """Write the summary when the block ends, however it ends, if there was a frame.

    It says what the track goes by, and the start that was `found`, too: the journal is not needed
    any more.
    """
    from ..io import write_json

    interrupted = False
    try:
        yield
    except KeyboardInterrupt:
        interrupted = True
        raise
    finally:
        if records[0].frames:
            facts = records[0].facts()
            if len(records) > 1:
                objects = {name: one.facts() for name, one in zip(names, records, strict=True)}
                facts = {"frames": records[0].frames, "objects": objects}
            facts = {
                **facts,
                **found,
                "interrupted": interrupted,
                **weights_facts(args.weights),
                **{name: value for name, value in journal.facts.items() if name.endswith(CONTENT)},
                "versions": versions(),
                "config": setting.config.as_dict(),
                "arguments": given(args),
            }
            write_json(args.output / "summary.json", facts)
            journal.finish()


def verdict(args: argparse.Namespace, records: Sequence[TrackSummary], names: Sequence[str]) -> int:
    """Print what became of the track; the exit code, or `InputError` if no frame was of use."""
    frames = records[0].frames
    if all(record.failed == frames for record in records):
        if not records[0].milliseconds:  # the time of a frame that was read is known
            failures = records[0].failures
            first = failures[0]["error"] if failures else "there was no frame."
            raise InputError(f"no frame could be tracked; the first says: {first}")
        what = "the object was" if len(records) == 1 else "the objects were"
        _say_not_found(args, what, frames, args.start)
        return NOT_FOUND
    for number, (record, name) in enumerate(zip(records, names, strict=True)):
        if record.failed == frames:
            _say_not_found(args, f"{name} was", frames, args.start and args.start[number])
        pace = record.facts()["median_milliseconds"] or 0.0
        lost = record.states.get("lost", 0)
        text = f"{frames} frames, {record.failed} failed, {pace:.0f} ms a frame"
        if lost:
            text += f", lost in {lost}"
        elif record.lost_from is not None:
            text += f", perhaps lost from frame {record.lost_from}"
        print(f"{name}: {text}: {args.output}" if name else f"{text}: {args.output}")
    return 0


def _say_not_found(args: argparse.Namespace, what: str, frames: int, start: Any) -> None:
    """Say that no frame shows an object, and what would narrow the search, if there was one."""
    searched = argparse.Namespace(**{**vars(args), "start": None})  # others may have one
    then = "" if start else advice(searched)
    said = f"{args.video}: {what} not found in any of {frames} frames{then}."
    print(f"moveit6d: {said}", file=sys.stderr)
