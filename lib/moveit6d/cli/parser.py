"""The command line's grammar: dashes or underscores, no abbreviations, and help with typing errors.

Never knows a verb.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from typing import Any, NoReturn

from .messages import BAD_USAGE


class Parser(argparse.ArgumentParser):
    """An argparse parser whose errors are one sentence.

    `--mesh-unit` and `--mesh_unit` are the same option. Options must be written out: abbreviations
    would change their meaning when options are added.
    """

    def __init__(self, *args: Any, **options: Any) -> None:
        options.setdefault("allow_abbrev", False)
        super().__init__(*args, **options)

    def parse_known_args(  # type: ignore[override]
        self, args: Sequence[str] | None = None, namespace: Any = None
    ) -> tuple[Any, list[str]]:
        """As argparse's, but an unknown option is an error before anything else is."""
        words = [spelt(word) for word in (args or ())]
        verbs = self._verbs()
        words = _verb_spelt(words, verbs)
        for word in _options(words, has_verbs=bool(verbs)):
            if word not in self._option_string_actions:
                self.error(f"there is no option {word}{_meant(word, self._option_string_actions)}")
        found, rest = super().parse_known_args(words, namespace)
        if rest and not verbs:
            self.error(f"{rest[0]!r} is one word too many")
        return found, rest

    def error(self, message: str) -> NoReturn:
        """End with the sentence and where to read on, instead of pages of usage."""
        self.exit(BAD_USAGE, f"{self.prog}: {message}. See {self.prog} --help.\n")

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        verbs = self._verbs()
        if isinstance(action, argparse._SubParsersAction) and value not in verbs:
            raise argparse.ArgumentError(None, f"there is no {value!r}{_meant(value, verbs)}")
        super()._check_value(action, value)

    def _verbs(self) -> tuple[str, ...]:
        for action in self._actions:
            if isinstance(action, argparse._SubParsersAction):
                return tuple(action.choices)
        return ()


def spelt(word: str) -> str:
    """An option with underscores, as they are declared; other words as they are."""
    if not word.startswith("--"):
        return word
    name, equals, value = word.partition("=")
    return "--" + name[2:].replace("-", "_") + equals + value


def _verb_spelt(words: list[str], verbs: Sequence[str]) -> list[str]:
    """The words with the verb's underscores as the dashes that verbs are declared with."""
    for place, word in enumerate(words):
        if not word.startswith("-"):
            dashed = word.replace("_", "-")
            return [*words[:place], dashed, *words[place + 1 :]] if dashed in verbs else words
    return words


def _options(words: Sequence[str], has_verbs: bool) -> Iterable[str]:
    """The names of the long options of a parser: those before its verb, if it has any."""
    for word in words:
        if word == "--" or (has_verbs and not word.startswith("-")):
            return
        if word.startswith("--"):
            yield word.partition("=")[0]


def _meant(word: str, known: Iterable[str]) -> str:
    near = get_close_matches(word, list(known), 1, 0.6)
    return f" (did you mean {near[0]}?)" if near else ""
