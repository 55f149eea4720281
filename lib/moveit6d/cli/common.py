"""What verbs share: exit codes, options, progress bars, facts for reports.

Never knows a single verb.
"""

from __future__ import annotations

import argparse
import platform
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from .. import __version__
from ..errors import InputError

if TYPE_CHECKING:
    from ..evaluation.run_tracker import TrackedFrame
    from ..networks.inference import Compute
    from ..policies import Policy
    from ..rendering.renderer import Renderer

DATASET_FORMATS = ("folders", "bop", "ycbv", "laval", "rbot")

UNITS = ("m", "cm", "mm", "in")  # those of `geometry.mesh.METRES`, which takes seconds to import

BAD_INPUT, NO_RENDERING, INTERRUPTED = 2, 3, 130

EXIT_CODES = """
exit codes:
  0    done
  1    a defect of this program; please report its output
  2    something given cannot be used; one sentence on stderr says what, where, what to do
  3    rendering is not possible on this machine; the message names what to install
  130  stopped by Ctrl-C, 128 + N by signal N; what was finished until then is kept
"""

Item = TypeVar("Item")


class ManualFormatter(argparse.RawDescriptionHelpFormatter):
    """Keeps the line breaks of descriptions and epilogs, and shows defaults of options."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog, max_help_position=28, width=92)

    def _get_help_string(self, action: argparse.Action) -> str | None:
        text = action.help or ""
        hidden = action.default in (None, argparse.SUPPRESS, False)
        return text if hidden or "%(default)" in text else f"{text} (default: %(default)s)"


def add_verb(
    verbs: Any, name: str, summary: str, description: str, epilog: str
) -> argparse.ArgumentParser:
    """A sub-command whose --help reads like a manual page."""
    parser: argparse.ArgumentParser = verbs.add_parser(
        name,
        help=summary,
        description=f"{summary[0].upper()}{summary[1:]}.\n\n{description}",
        epilog=epilog + EXIT_CODES,
        formatter_class=ManualFormatter,
    )
    return parser


def add_tracking_options(parser: argparse.ArgumentParser) -> None:
    """The options of whatever runs the loop."""
    group = parser.add_argument_group("tracking")
    group.add_argument(
        "--weights", type=Path, metavar="FILE", help="weights file instead of the shipped one"
    )
    group.add_argument(
        "--max_iterations",
        type=positive,
        metavar="N",
        help="iterations per frame at most (default: 8, with single actions 30)",
    )
    group.add_argument(
        "--single_actions",
        action="store_true",
        help="one of the 13 actions per iteration, as in the paper, instead of all axes at once",
    )
    add_machine_options(group)


def add_beyond_paper_options(parser: argparse.ArgumentParser) -> None:
    """Of whatever refines poses: what goes past the paper's loop and can be left out."""
    parser.add_argument(
        "--no_multi_start",
        action="store_true",
        help="no other starts while the confidence is low (multi-start refinement)",
    )
    parser.add_argument(
        "--no_contour",
        action="store_true",
        help="no region-based refinement of the network's poses",
    )


def add_untextured_option(parser: argparse.ArgumentParser) -> None:
    """Of whatever reads a mesh of the user's."""
    parser.add_argument(
        "--allow_untextured",
        action="store_true",
        help="go on where the mesh's picture or material is missing, or it is of one flat colour",
    )


def add_machine_options(group: Any) -> None:
    """Renderer and threads."""
    group.add_argument(
        "--renderer",
        choices=("embree", "pyrender"),
        default="embree",
        help="embree casts rays on the CPU and runs everywhere; pyrender needs OpenGL",
    )
    # More threads hardly help a network this small, and hurt much where the machine is busy.
    group.add_argument(
        "--threads", type=positive, default=1, metavar="N", help="CPU threads of the network"
    )
    group.add_argument(
        "--float32",
        action="store_true",
        help="convolutions in float32 also where the processor has AMX: slower, as elsewhere",
    )


def add_jobs_options(parser: argparse.ArgumentParser) -> None:
    """Where the work is done: here, in several processes, or on a cluster."""
    group = parser.add_mutually_exclusive_group()
    group.add_argument(
        "--jobs", type=positive, default=1, metavar="N", help="processes beside each other"
    )
    group.add_argument(
        "--ray", metavar="ADDRESS", help="Ray cluster to work on: auto, local, ray://HOST:10001"
    )


def positive(text: str) -> int:
    """An option's whole number above zero."""
    try:
        value = int(text)
    except ValueError:
        value = 0
    if value < 1:
        raise argparse.ArgumentTypeError(f"must be a whole number above 0, found {text!r}")
    return value


def use_threads(count: int) -> None:
    """Limit torch to this many CPU threads."""
    import torch

    torch.set_num_threads(count)


@dataclass(frozen=True)
class Setting:
    """What decides about the loop, as it can be sent to another process or machine."""

    weights: Path | None
    renderer: str
    threads: int
    max_iterations: int | None
    contour: bool = True
    single_actions: bool = False
    calibration: bool = True
    multi_start: bool = True
    compute: Compute = "auto"

    @staticmethod
    def of(args: argparse.Namespace) -> Setting:
        """By the options of `add_tracking_options`; a weights file is found from anywhere."""
        weights = None if args.weights is None else args.weights.resolve()
        contour = not getattr(args, "no_contour", False)
        single = getattr(args, "single_actions", False)
        calibration = not getattr(args, "no_calibration", False)
        multi_start = not getattr(args, "no_multi_start", False)
        return Setting(
            weights,
            args.renderer,
            args.threads,
            args.max_iterations,
            contour,
            single,
            calibration,
            multi_start,
            _compute(args),
        )


@lru_cache(maxsize=1)
def tools(setting: Setting) -> tuple[Policy, Renderer]:
    """Policy and renderer of a worker process, made once."""
    return _make_tools(
        setting.weights, setting.renderer, setting.threads, setting.single_actions, setting.compute
    )


def set_up(args: argparse.Namespace) -> tuple[Policy, Renderer]:
    """Policy and renderer by the options of `add_tracking_options`."""
    single = getattr(args, "single_actions", False)
    return _make_tools(args.weights, args.renderer, args.threads, single, _compute(args))


def _compute(args: argparse.Namespace) -> Compute:
    return "float32" if args.float32 else "auto"


def _make_tools(
    weights: Path | None, renderer: str, threads: int, single_actions: bool, compute: Compute
) -> tuple[Policy, Renderer]:
    from ..policies import ActionMode, load_policy
    from ..rendering.renderer import make_renderer

    use_threads(threads)
    mode = ActionMode.SINGLE if single_actions else None
    return load_policy(weights, mode, compute), make_renderer(renderer)


def progress(
    items: Iterable[Item], total: int | None, what: str, unit: str = "frame"
) -> Iterator[Item]:
    """The items, with a bar and the time left on stderr while it is a terminal."""
    with progress_bar(total, what, unit) as bar:
        for item in items:
            yield item
            bar.update()


def progress_bar(total: int | None, what: str, unit: str = "frame") -> Any:
    """A bar on stderr with the time left, to be moved on by `update()`; none but on a terminal."""
    from tqdm import tqdm

    return tqdm(total=total, desc=what, unit=unit, file=sys.stderr, disable=None, leave=False)


def note(text: str) -> None:
    """A line on stderr that does not tear a progress bar."""
    from tqdm import tqdm

    tqdm.write(f"moveit6d: {text}", file=sys.stderr)


def complaining(steps: Iterable[TrackedFrame], prefix: str = "") -> Iterator[TrackedFrame]:
    """The same steps, with a line on stderr where frames begin to fail or fail differently."""
    last = None
    for step in steps:
        if step.error is not None and step.error != last:
            note(f"{prefix}frame {step.frame.index}: {step.error}")
        last = step.error
        yield step


def versions() -> dict[str, str]:
    """Versions of what decides the numbers."""
    found = {"moveit6d": __version__, "python": platform.python_version()}
    for name in ("torch", "kornia", "numpy", "embreex", "trimesh"):
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "not installed"
    return found


def weights_facts(path: Path | None) -> dict[str, str | None]:
    """The weights file by name and SHA-256; None stands for the shipped one."""
    import hashlib

    from ..policies import SHIPPED_WEIGHTS

    file = SHIPPED_WEIGHTS if path is None else path
    there = file.is_file()
    return {
        "weights": file.name,
        "weights_sha256": hashlib.sha256(file.read_bytes()).hexdigest() if there else None,
    }


def given(args: argparse.Namespace) -> dict[str, Any]:
    """The arguments of a command as JSON can hold them."""
    return {
        key: str(value) if isinstance(value, Path) else value
        for key, value in sorted(vars(args).items())
        if key != "run"
    }


def new_folder(path: Path) -> Path:
    """The folder for the results, made if it is missing."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{path} cannot be made a folder: {error.strerror}.") from error
    return path
