"""The grammar: dashes or underscores, no abbreviations, one sentence for a typing error."""

from __future__ import annotations

import subprocess
import sys
from argparse import Namespace

import pytest

from moveit6d.cli import doctor
from moveit6d.cli.main import main, make_parser
from moveit6d.cli.messages import is_verbose
from moveit6d.errors import InputError

NEEDED = {"doctor": [], "evaluate": ["--dataset", "d", "--split", "s", "--results", "r"]}
TRACK = ["--mesh", "m.ply", "--video", "v", "--camera", "c", "--start", "s", "--output", "o"]


@pytest.mark.parametrize(
    "words",
    [
        ["track", *TRACK, "--mesh-unit", "mm", "--exact-start", "--no-overlay"],
        ["track", *TRACK, "--mesh_unit=mm", "--exact_start", "--no_overlay"],
        ["track", *TRACK, "--mesh-unit=mm", "--exact-start", "--no_overlay"],
    ],
)
def test_dashes_and_underscores_are_the_same(words: list[str]) -> None:
    args = make_parser().parse_args(words)
    assert args.mesh_unit == ["mm"] and args.exact_start and args.no_overlay


def test_values_keep_their_dashes_and_verbs_their_spelling() -> None:
    words = ["track", *TRACK[:2], "--video=my--clip-1.mp4", *TRACK[4:], "--mesh_unit", "m"]
    assert make_parser().parse_args(words).video == "my--clip-1.mp4"
    spelt = make_parser().parse_args(["contact_sheet", "--output", "x.png"])
    assert spelt.run is make_parser().parse_args(["contact-sheet", "--output", "x.png"]).run


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["track", "--exat_start"], "no option --exat_start (did you mean --exact_start?)"),
        (["track", "--no_ov"], "no option --no_ov"),
        (["track", "--max", "2"], "no option --max"),
        (["trakc"], "no 'trakc' (did you mean track?)"),
        (["doctor", "extra"], "'extra' is one word too many"),
        (["evaluate", "bop", "--datset", "x"], "did you mean --dataset?"),
        (["--verion"], "did you mean --version?"),
        (["track", "--mesh"], "expected one argument"),
    ],
)
def test_a_typing_error_is_one_sentence(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(words)
    (line,) = capsys.readouterr().err.splitlines()
    assert ended.value.code == 2 and said in line
    verb = [word for word in words[:2] if word in ("track", "doctor", "evaluate", "bop")]
    assert line.endswith(f"See {' '.join(['moveit6d', *verb])} --help.")


@pytest.mark.parametrize("verb", [["doctor"], ["evaluate", "bop"]])
def test_how_much_is_said_may_stand_before_the_verb_or_behind_it(
    verb: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    for words in ([], ["--quiet"], ["-v"]):
        before = make_parser().parse_args([*words, *verb, *NEEDED[verb[0]]])
        behind = make_parser().parse_args([*verb, *words, *NEEDED[verb[0]]])
        assert vars(before) == vars(behind)
    with pytest.raises(SystemExit):
        main(["-q", *verb, "-v", *NEEDED[verb[0]]])
    assert "not allowed with argument -q" in capsys.readouterr().err


def test_quiet_and_verbose(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(args: Namespace) -> int:
        assert is_verbose()
        raise InputError("no such thing.")

    monkeypatch.setattr(doctor, "run", fail)
    assert main(["doctor", "-v"]) == 2
    said = capsys.readouterr().err
    assert "Traceback" in said and said.endswith("moveit6d: no such thing.\n")
    monkeypatch.setattr(doctor, "run", lambda args: int(is_verbose()))
    assert main(["doctor", "-q"]) == 0
    with pytest.raises(SystemExit):
        main(["doctor", "-q", "-v"])


def test_who_reads_the_output_may_stop() -> None:
    """`moveit6d --help | head -1` and the like: no traceback."""
    code = (
        "import sys; from moveit6d.cli import doctor, main; "
        "doctor.run = lambda args: print('x' * 100000) or print('y' * 100000) or 0; "
        "sys.exit(main.main(['doctor']))"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        assert process.stdout is not None and process.stderr is not None
        process.stdout.read(1)
        process.stdout.close()
        assert process.stderr.read() == b""
        assert process.wait() == 141


def test_the_package_runs_as_a_module() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "moveit6d", "--version"], capture_output=True, text=True, check=True
    )
    assert done.stdout.startswith("moveit6d ")
