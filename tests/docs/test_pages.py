"""README and docs: their Python runs, and every command has the options that they name."""

from __future__ import annotations

import argparse
import itertools
import re
from pathlib import Path

import pytest

from moveit6d.cli.main import make_parser

ROOT = Path(__file__).parents[2]
# Notebooks and results record commands as they were typed then.
PAGES = [
    ROOT / "README.md",
    ROOT / "docs" / "index.md",
    ROOT / "docs" / "method.md",
    *sorted((ROOT / "docs" / "how-to").glob("*.md")),
    *sorted((ROOT / "docs" / "reference").glob("*.md")),
]


def blocks(page: Path, language: str) -> list[str]:
    """The code blocks of a page in one language."""
    text = page.read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```", text, re.MULTILINE | re.DOTALL)


def commands(text: str) -> list[str]:
    """Every command `moveit6d …` of a code block or in backquotes, its lines joined."""
    code = "\n".join(re.findall(r"^```(?:sh)?\n(.*?)^```", text, re.MULTILINE | re.DOTALL))
    found = re.findall(r"^(?:\S*/)?moveit6d (.+)$", code.replace("\\\n", " "), re.MULTILINE)
    text = re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL)
    return found + re.findall(r"`moveit6d ([^`]+)`", re.sub(r"\n(?! *\n)", " ", text))


def options_of(parser: argparse.ArgumentParser, words: list[str]) -> set[str] | None:
    """The options of the verb (and kind) that the words name; None for a verb that is not there."""
    options = {option for action in parser._actions for option in action.option_strings}
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction) and words:
            if words[0].isupper():  # whichever it is
                each = (options_of(one, words[1:]) or set() for one in action.choices.values())
                return options.union(*each)
            if words[0] not in action.choices:
                return None
            return options_of(action.choices[words[0]], words[1:])
    return options


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_commands_have_these_options(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for command in commands(text):
        words = re.split(r"[\s…]+", command.split("#")[0].strip())
        if words[0] == "fit":  # LightningCLI's own options
            continue
        verbs = list(itertools.takewhile(lambda word: not word.startswith("-"), words))
        known = options_of(make_parser(), verbs)
        assert known is not None, f"there is no command: moveit6d {command}"
        named = {word.split("=")[0] for word in words if word.startswith("--")}
        assert named <= known, f"moveit6d {command}: no {named - known}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_python_is_whole(page: Path) -> None:
    for block in blocks(page, "python"):
        compile(block, str(page), "exec")
