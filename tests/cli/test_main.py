"""The front door: verbs, manual pages, exit codes; nothing heavy before a verb runs."""

from __future__ import annotations

import subprocess
import sys
from argparse import Namespace

import pytest

from moveit6d import __version__
from moveit6d.cli import doctor
from moveit6d.cli.main import main
from moveit6d.errors import InputError, RenderingUnavailable, WeightsError

VERBS = [
    "track",
    "refine",
    "detect",
    "evaluate",
    "benchmark",
    "reproduce",
    "synthesize",
    "fit",
    "demo",
    "doctor",
    "contact-sheet",
    "write-pairs",
]


def printed(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 0
    return capsys.readouterr().out


def test_help_names_every_verb_and_every_exit_code(capsys: pytest.CaptureFixture[str]) -> None:
    text = printed(["--help"], capsys)
    for word in (*VERBS, "exit codes:", "  2 ", "  3 ", "  130 "):
        assert word in text


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_has_a_manual_page(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    text = printed([verb, "--help"], capsys)
    assert "exit codes:" in text and len(text.splitlines()) > 15
    assert max(map(len, text.splitlines())) <= 100
    of_verb = {"evaluate": ["tracking", "bop", "ycbv"], "benchmark": ["tracking", "iteration"]}
    kinds = of_verb.get(verb, [])
    for kind in kinds:
        assert "examples:" in printed([verb, kind, "--help"], capsys)
    assert kinds or "examples:" in text


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert printed(["--version"], capsys) == f"moveit6d {__version__}\n"


@pytest.mark.parametrize(
    "arguments", [[], ["dance"], ["track"], ["track", "--max_iterations", "0"]]
)
def test_wrong_arguments_are_bad_input(
    arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    said = capsys.readouterr().err
    assert ended.value.code == 2 and said.startswith("moveit6d") and len(said.splitlines()) == 1


@pytest.mark.parametrize(
    ("error", "code", "words"),
    [
        (InputError("mesh.obj has no faces."), 2, "moveit6d: mesh.obj has no faces."),
        (WeightsError("weights are damaged."), 2, "moveit6d: weights are damaged."),
        (RenderingUnavailable("install libegl1."), 3, "moveit6d: install libegl1."),
        (KeyboardInterrupt(), 130, "what was finished is kept"),
    ],
)
def test_errors_become_one_sentence_and_an_exit_code(
    error: BaseException,
    code: int,
    words: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def fail(args: Namespace) -> int:
        raise error

    monkeypatch.setattr(doctor, "run", fail)
    assert main(["doctor"]) == code
    said = capsys.readouterr()
    assert said.out == "" and words in said.err and len(said.err.splitlines()) == 1


def test_a_defect_is_not_hidden(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(args: Namespace) -> int:
        raise ZeroDivisionError

    monkeypatch.setattr(doctor, "run", fail)
    with pytest.raises(ZeroDivisionError):
        main(["doctor"])


def test_the_help_loads_nothing_heavy() -> None:
    code = (
        "import sys; from moveit6d.cli.main import make_parser; make_parser().format_help(); "
        "heavy = {'torch', 'cv2', 'av', 'pyrender', 'matplotlib', 'pytorch_lightning', 'trimesh'};"
        "print(sorted(heavy & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
