"""What verbs share: exit codes, options, facts for reports.

Never knows a single verb.
"""

from __future__ import annotations

import argparse
import platform
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from .. import __version__
from ..config import TrackerConfig
from ..errors import InputError
from ..io import check_folder, file_digest
from .messages import NORMAL, QUIET, VERBOSE, add_message_options, get_level, set_level
from .settings import DEFAULT, EVERYTHING, PREFIX, SettingsPart, add_settings, settings_of
from .watching import Watcher

if TYPE_CHECKING:
    from ..evaluation.run_tracker import TrackedFrame
    from ..geometry.mesh import Mesh
    from ..networks.inference import Compute
    from ..policies import Policy
    from ..rendering.renderer import Renderer

DATASET_FORMATS = ("folders", "bop", "ycbv", "laval", "rbot")

UNITS = ("m", "cm", "mm", "in")  # those of `geometry.mesh.METRES`, which takes seconds to import

# Those of `synthesis.training.clusters`, which takes long to import, too.
CLUSTERS = ("one_small", "one_large", "one_large_rest_small", "all_small", "all_large", "near")

BAD_INPUT, NO_RENDERING, INTERRUPTED, BROKEN_PIPE = 2, 3, 130, 141
NOT_FOUND = 3  # of verbs that look for an object

EXIT_CODES = """
exit codes:
  0    done
  1    a defect of this program; please report its output
  2    something given cannot be used; one sentence on stderr says what, where, what to do
  3    rendering is not possible on this machine; the message names what to install
  130  stopped by Ctrl-C, 128 + N by signal N; what was finished until then is kept
  141  who read the output stopped reading (as in `moveit6d … | head`)
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
    add_message_options(parser)
    return parser


def add_tracking_options(
    parser: argparse.ArgumentParser, base: TrackerConfig = DEFAULT, part: SettingsPart = EVERYTHING
) -> None:
    """The options of whatever runs the loop; `base` are the settings without any option.

    `part` are the settings that it reads.
    """
    group = parser.add_argument_group("tracking")
    group.add_argument(
        "--weights", type=Path, metavar="FILE", help="weights file instead of the shipped one"
    )
    add_machine_options(group)
    add_network_options(group)
    add_settings(parser, base, part)


def add_untextured_option(parser: argparse.ArgumentParser) -> None:
    """Of whatever reads a mesh of the user's."""
    parser.add_argument(
        "--allow_untextured",
        action="store_true",
        help="go on where the mesh's picture or material is missing, or it is of one flat colour",
    )


def mesh_or_demo(args: argparse.Namespace) -> Mesh:
    """The mesh of `--mesh`, or the demonstration's toy robot if none is given."""
    from ..geometry.mesh import Mesh
    from ..synthesis.objects.demo_object import demo_object

    check_mesh_options(args)
    if args.mesh is None:
        return demo_object()
    return Mesh.load(args.mesh, args.mesh_unit or "m", allow_untextured=args.allow_untextured)


def check_mesh_options(args: argparse.Namespace) -> None:
    """`InputError` for options about a mesh where none is given."""
    for option in ("mesh_unit", "allow_untextured"):
        if args.mesh is None and getattr(args, option):
            raise InputError(f"--{option} needs --mesh, the file that it is about.")


def add_machine_options(group: Any) -> None:
    """Renderer and threads, of whatever renders."""
    group.add_argument(
        "--renderer",
        choices=("embree", "pyrender"),
        default="embree",
        help="embree casts rays on the CPU and runs everywhere; pyrender needs OpenGL",
    )
    # More threads hardly help a network this small, and hurt much where the machine is busy.
    group.add_argument(
        "--threads", type=positive, default=1, metavar="N", help="CPU threads to compute with"
    )


def add_network_options(group: Any) -> None:
    """What the network computes with."""
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


def seed(text: str) -> int:
    """An option's whole number, 0 or above."""
    if not (text.isascii() and text.isdigit()):
        raise argparse.ArgumentTypeError(f"must be a whole number, 0 or above, found {text!r}")
    return int(text)


def positive(text: str) -> int:
    """An option's whole number above zero."""
    try:
        value = int(text)
    except ValueError:
        value = 0
    if value < 1:
        raise argparse.ArgumentTypeError(f"must be a whole number above 0, found {text!r}")
    return value


def share(text: str) -> float:
    """An option's number from 0 to 1."""
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0 <= value <= 1:
        raise argparse.ArgumentTypeError(f"must be a number from 0 to 1, found {text!r}")
    return value


def use_threads(count: int) -> None:
    """Limit torch to this many CPU threads."""
    import torch

    torch.set_num_threads(count)


@dataclass(frozen=True)
class Setting:
    """What decides about the loop, as it can be sent to another process or machine.

    `level` is how much a worker says on stderr.
    """

    weights: Path | None
    renderer: str
    threads: int
    compute: Compute = "auto"
    config: TrackerConfig = DEFAULT
    level: int = NORMAL

    @staticmethod
    def of(args: argparse.Namespace, base: TrackerConfig = DEFAULT) -> Setting:
        """By the options of `add_tracking_options`; a weights file is found from anywhere."""
        weights = None if args.weights is None else args.weights.resolve()
        compute: Compute = "float32" if args.float32 else "auto"
        config = settings_of(args, base)
        return Setting(weights, args.renderer, args.threads, compute, config, get_level())


@lru_cache(maxsize=1)
def tools(setting: Setting) -> tuple[Policy, Renderer]:
    """Policy and renderer of a worker process, made once; it says as much as its parent."""
    set_level(setting.level == QUIET, setting.level == VERBOSE)
    return make_tools(setting)


def make_tools(setting: Setting) -> tuple[Policy, Renderer]:
    """Policy and renderer by a setting."""
    from ..policies import load_policy
    from ..rendering.backends import make_renderer

    use_threads(setting.threads)
    policy = load_policy(setting.weights, compute=setting.compute)
    return policy, make_renderer(setting.renderer)


def complaining(steps: Iterable[TrackedFrame], prefix: str = "") -> Iterator[TrackedFrame]:
    """The same steps, with a line on stderr where frames begin to fail or fail differently.

    And where the confidence goes and comes back (`watching`); for each object.
    """
    watchers: dict[str, Watcher] = {}
    for step in steps:
        for one in (step, *step.others):
            name = one.row.object
            if name not in watchers:
                watchers[name] = Watcher(f"{prefix}{name}: " if name else prefix)
            watchers[name].see(one)
        yield step


def versions() -> dict[str, str]:
    """Versions of what decides the numbers."""
    from importlib import metadata

    found = {"moveit6d": __version__, "python": platform.python_version()}
    for name in ("torch", "kornia", "numpy", "embreex", "trimesh"):
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "not installed"
    return found


def weights_facts(path: Path | None) -> dict[str, str | None]:
    """The weights file by name and SHA-256; None stands for the shipped one."""
    from ..policies import SHIPPED_WEIGHTS

    file = SHIPPED_WEIGHTS if path is None else path
    digest = file_digest(file) if file.is_file() else None
    return {"weights": file.name, "weights_sha256": digest}


def run_facts(setting: Setting) -> dict[str, Any]:
    """What poses depend on by the options of `add_tracking_options`, as a journal holds it.

    The weights go by their content and may lie elsewhere.
    """
    return {
        "weights": weights_facts(setting.weights)["weights_sha256"],
        "renderer": setting.renderer,
        "compute": setting.compute,
        "config": setting.config.as_dict(),
    }


def given(args: argparse.Namespace) -> dict[str, Any]:
    """The arguments of a command as JSON can hold them."""
    return {
        key.removeprefix(PREFIX): plain(value)
        for key, value in sorted(vars(args).items())
        if key != "run"
    }


def plain(value: Any) -> Any:
    """An argument as JSON can hold it."""
    if isinstance(value, list):
        return [plain(one) for one in value]
    return str(value) if isinstance(value, Path) else value


def new_folder(path: Path) -> Path:
    """The folder for the results, made if it is missing.

    `InputError`, before any long work, where nothing can be written in it.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{path} cannot be made a folder: {error.strerror}.") from error
    check_folder(path)
    return path


def targets_file(path: Path) -> str:
    """A targets file of a BOP data set: one in the working folder, or else in the data set's."""
    return str(path.resolve() if path.is_file() else path)
