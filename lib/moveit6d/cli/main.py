"""`moveit6d VERB …`: finds the verb, runs it, and turns errors into sentences and exit codes.

Never computes anything; imports nothing heavy before a verb runs.
"""

from __future__ import annotations

import argparse
import itertools
import os
import sys
import traceback
from collections.abc import Callable, Sequence

from .. import __version__
from ..errors import InputError, RenderingUnavailable
from . import (
    benchmark,
    calibrate,
    contact_sheet,
    demo,
    detect,
    doctor,
    evaluate,
    fit,
    refine,
    reproduce,
    synthesize,
    track,
    write_pairs,
)
from .common import (
    BAD_INPUT,
    BROKEN_PIPE,
    EXIT_CODES,
    INTERRUPTED,
    NO_RENDERING,
    ManualFormatter,
)
from .messages import (
    QUIETLY,
    VERBOSELY,
    add_message_options,
    is_verbose,
    set_level,
    warnings_as_notes,
)
from .parser import Parser
from .signals import Terminated, ending_like_ctrl_c

LONGEST = 600  # characters of an error

DESCRIPTION = """\
Follow an object's 6D pose (rotation and translation) through a video, given the object's
mesh and the camera's intrinsics. No training on the object.
"""

EXAMPLES = """\
examples:
  moveit6d track --mesh drill.glb --mesh_unit m --video clip.mp4 \\
      --camera camera.json --start pose.json --output out
  moveit6d doctor

`moveit6d VERB --help` is the manual page of a verb.
"""


def make_parser() -> Parser:
    """The parser of all verbs."""
    parser = Parser(
        prog="moveit6d",
        description=DESCRIPTION,
        epilog=EXAMPLES + EXIT_CODES,
        formatter_class=ManualFormatter,
    )
    parser.add_argument("--version", action="version", version=f"moveit6d {__version__}")
    add_message_options(parser)
    verbs = parser.add_subparsers(title="verbs", metavar="VERB", required=True)
    shown = (
        track,
        refine,
        detect,
        calibrate,
        evaluate,
        benchmark,
        reproduce,
        synthesize,
        fit,
        contact_sheet,
        write_pairs,
        demo,
        doctor,
    )
    for verb in shown:
        verb.add_parser(verbs)
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns its exit code. `arguments` default to the process's own."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    before = list(itertools.takewhile(lambda word: word in (*QUIETLY, *VERBOSELY), given))
    verb, words = given[len(before) :][:1], given[len(before) + 1 :]
    if verb == ["fit"] and words not in (["--help"], ["-h"]):
        return guarded(lambda: fit.forward([*before, *words]))
    parser = make_parser()
    args = parser.parse_args(given)
    _set_level(parser, args)
    return guarded(lambda: int(args.run(args) or 0))


def _set_level(parser: Parser, args: argparse.Namespace) -> None:
    """As much is said as -q and -v ask for, before and after the verb."""
    quiet, verbose = getattr(args, "quiet", False), getattr(args, "verbose", False)
    if quiet and verbose:
        parser.error("argument -v/--verbose: not allowed with argument -q/--quiet")
    set_level(quiet, verbose)


def guarded(action: Callable[[], int]) -> int:
    """The action's exit code, or that of the error it ended with; errors go to stderr."""
    try:
        with ending_like_ctrl_c(), warnings_as_notes():
            code = action()
            sys.stdout.flush()
        return code
    except BrokenPipeError:
        # Python flushes stdout once more at its end: nobody reads that either.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return BROKEN_PIPE
    except InputError as error:
        if is_verbose():
            traceback.print_exc()
        print(f"moveit6d: {_sentence(error)}", file=sys.stderr)
        return BAD_INPUT
    except RenderingUnavailable as error:
        print(f"moveit6d: {error}", file=sys.stderr)
        return NO_RENDERING
    except Terminated as ending:
        print(f"moveit6d: stopped by {ending}; what was finished is kept.", file=sys.stderr)
        return ending.code
    except KeyboardInterrupt:
        print("moveit6d: stopped; what was finished is kept.", file=sys.stderr)
        return INTERRUPTED


def _sentence(error: InputError) -> str:
    """An error on one line of bounded length, whatever was found in a file."""
    text = " ".join(str(error).split())
    return text if len(text) <= LONGEST else f"{text[:LONGEST]} …"


if __name__ == "__main__":
    sys.exit(main())
