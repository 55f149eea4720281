"""No word that was given up comes back, and one name means one thing."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

from tools.retired_words import in_file

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize(
    ("name", "text", "found"),
    [
        ("a.py", "def write_stand_in() -> None: ...", True),
        ("a.py", "class StandIn: ...", True),
        ("a.py", "POLISH = 1", True),
        ("a.py", "standing = outstanding_items", False),
        ("stand_ins.py", "x = 1", True),
        ("a.md", "## The outline has the last word", True),
        ("a.md", "It has the last word.", False),
        ("a.md", "run it with `--no_regions`", True),
        ("a.sh", "moveit6d track --no_contour", False),
        ("a.py", '"""As in METHOD 9b."""', True),
    ],
)
def test_it_finds_identifiers_options_names_and_headings(
    tmp_path: Path, name: str, text: str, found: bool
) -> None:
    (tmp_path / name).write_text(text)
    lines = list(in_file(tmp_path / name))
    lines = [line for line in lines if not line.startswith(f"{tmp_path}:")]
    assert bool(lines) == found, lines


def test_the_project_is_free_of_them() -> None:
    if subprocess.run(["git", "rev-parse"], cwd=ROOT, capture_output=True).returncode:
        pytest.skip("needs the repository's list of files")
    done = subprocess.run(
        [sys.executable, "tools/retired_words.py"], cwd=ROOT, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout


def test_no_two_public_classes_share_a_name() -> None:
    names = Counter(
        node.name
        for path in (ROOT / "lib").rglob("*.py")
        for node in ast.parse(path.read_text(encoding="utf-8")).body
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_")
    )
    assert [name for name, count in names.items() if count > 1] == []
