"""Finds words that the project has given up for the field's own. Run in its root.

    python tools/retired_words.py

Looks at identifiers (also parts of them, as in `stand_in_name`), options, file names and headings.
Common English words that were used in a sense of our own (step, way, made, table) are left out:
a reader has to judge those.
"""

from __future__ import annotations

import io
import re
import subprocess
import sys
import tokenize
from collections.abc import Iterator
from pathlib import Path

# Identifier (lower case, parts joined by _): what is said instead.
IDENTIFIERS = {
    "last_word": "contour refinement, refine_contour",
    "polish": "refine_contour",
    "polished": "ContourRefinement",
    "look_closely": "fine stage",
    "doubtful": "low_confidence",
    "believed": "above_low, confident",
    "surest": "most_confident",
    "hypotheses": "track_state",
    "situation": "LoopState",
    "decision": "PolicyOutput, prediction",
    "turned_policy": "DihedralAugmentation",
    "judge": "SelectionCriterion",
    "cell_answer": "DensePrediction",
    "cell_truth": "DenseTruth",
    "deeper": "extra_blocks",
    "narrow": "bfloat16",
    "bare": "untextured",
    "twins": "same_colour_distractors",
    "smeared": "motion_blurred",
    "dice": "RandomSource, rng",
    "lamp": "light",
    "wander": "SmoothPath",
    "passage": "PassingOccluder",
    "stand_in": "surrogate",
    "stand_ins": "surrogates",
    "shoot": "render_frame",
    "strips": "snapshots",
    "plain_camera": "default_camera",
    "accumulate": "metrics",
    "cycle": "iteration",
    "cycles": "iterations",
    "move_mode": "ActionMode",
    "draw_counts": "draw_delta",
    "nearest_counts": "nearest_delta",
}
# Parts that may stand inside of a longer name.
ALLOWED = {"accumulate_grad_batches", "bare_machine"}
OPTIONS = (
    "--level", "--max_steps", "--no_search", "--no_regions", "--no_learning", "--judge",
    "--covered", "--data.bare", "--data.rollouts.cycles",
)  # fmt: skip
HEADINGS = (
    "last word", "polish", "closely", "in doubt", "believed", "stand-in", "hypothes", "cycle",
    "rollout", "twins", "METHOD", "PROTOTYPE",
)  # fmt: skip
NOTES = re.compile(r"\b(METHOD \d|PROTOTYPE)")
SUFFIXES = {".py", ".md", ".sh", ".yaml", ".toml"}
EXEMPT = {"tools/retired_words.py", "tests/tools/test_retired_words.py"}


def in_file(path: Path) -> Iterator[str]:
    """Every retired word in a file, as `path:line: word → instead`."""
    for part in path.with_suffix("").parts:
        yield from _in_name(part, f"{path}")
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".py":
        for token in tokenize.generate_tokens(io.StringIO(text).readline):
            if token.type == tokenize.NAME:
                yield from _in_name(token.string, f"{path}:{token.start[0]}")
    for number, line in enumerate(text.splitlines(), 1):
        where = f"{path}:{number}"
        yield from (f"{where}: {option}" for option in OPTIONS if re.search(rf"{option}\b", line))
        if found := NOTES.search(line):
            yield f"{where}: {found[0]}: name the page of the docs or the paper's section"
        if path.suffix == ".md" and line.startswith("#"):
            yield from (f"{where}: {word!r} in a heading" for word in HEADINGS if word in line)


def _in_name(name: str, where: str) -> Iterator[str]:
    """Retired words that an identifier is made of: `StandIn`, `stand_in_name`, `STAND_IN`."""
    parts = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).lower().strip("_")
    if parts in ALLOWED:
        return
    for word, instead in IDENTIFIERS.items():
        if re.search(rf"(^|_){word}(_|$)", parts):
            yield f"{where}: {name} → {instead}"


def main() -> int:
    """Print what is found in all that git knows; 1 if there is anything."""
    listed = subprocess.run(["git", "ls-files", "-z"], capture_output=True, text=True, check=True)
    paths = [Path(name) for name in listed.stdout.split("\0") if name and name not in EXEMPT]
    found = [
        line
        for path in paths
        if path.suffix in SUFFIXES and path.is_file()
        for line in in_file(path)
    ]
    print("\n".join(found), end="\n" if found else "")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
