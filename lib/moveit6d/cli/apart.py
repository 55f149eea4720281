"""What a run writes, kept apart from what it reads: no input is lost to an output.

Never writes or removes anything.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import InputError
from ..extras import require
from ..io import IS_READ, check_places, check_writable
from .earlier import holds_results
from .journal import journal_file

if TYPE_CHECKING:
    from ..datasets.sequences import Sequence


def given_paths(args: argparse.Namespace, *written: str) -> Iterator[Path]:
    """The files and folders that the arguments name, but those of the options in `written`."""
    for name, value in vars(args).items():
        if name not in written:
            for one in value if isinstance(value, list) else [value]:
                if isinstance(one, Path):
                    yield one


def files_of_sequences(sequences: Iterable[Sequence]) -> list[Path]:
    """The files that sequences are read from, each once."""
    return list(dict.fromkeys(path for sequence in sequences for path in sequence.files))


def folders_of(args: argparse.Namespace) -> list[Path]:
    """The folders of a BOP data set in which all files are inputs: the split, and the models."""
    return [args.dataset / args.split, *args.dataset.glob("models*")]


def check_result(args: argparse.Namespace, *more: Path) -> None:
    """`InputError` where the result file of a BOP data set cannot be written, or destroys an input.

    `more` are inputs beside those that the arguments name as paths.
    """
    written = {"--output": (args.output, journal_file(args.output))}
    check_apart(written, [*given_paths(args, "output"), *more], folders_of(args))
    check_writable(args.output)


def check_apart(
    written: Mapping[str, Iterable[Path | None]],
    read: Iterable[Path],
    folders: Iterable[Path] = (),
) -> None:
    """`InputError` where a file of an option would take the place of another one of the run.

    `written` are the options with their files, or with a folder that is replaced by a new one;
    `read` the inputs, which stand for what a mesh names, too; in `folders` all files are inputs.
    """
    from ..geometry.mesh_files import SUFFIXES
    from ..geometry.mesh_files.digest import files_of_mesh

    taken = dict.fromkeys(read, IS_READ)
    for mesh in list(taken):
        if mesh.suffix.lower() in SUFFIXES and mesh.is_file():
            for path in files_of_mesh(mesh):
                taken.setdefault(path, f"{mesh} names")
    check_places(written, taken, folders)


def check_chart(
    args: argparse.Namespace,
    option: str,
    read: Iterable[Path] = (),
    folders: Iterable[Path] = (),
) -> None:
    """`InputError` where the chart of an option, if there is to be one, cannot be drawn.

    Or where it destroys an input: `read` are inputs beside those that the arguments name; in
    `folders` all files are inputs.
    """
    from ..visualization.plots import files_of_chart

    path = getattr(args, option)
    if path is None:
        return
    require("report", f"--{option}")
    written = {f"--{option}": files_of_chart(path)}
    check_apart(written, [*given_paths(args, option), *read], folders)


def check_truth(output: Path, frames: Iterable[Path]) -> None:
    """`InputError` where a table of poses would replace the true ones of a sequence's folder.

    That is a poses.csv beside the frames or their folder that is of no earlier run.
    """
    table, place = output / "poses.csv", output.resolve()
    beside = {folder.resolve() for folder in {path.parent for path in frames}}
    if not table.is_file() or holds_results(output):
        return
    if place in beside or place in {folder.parent for folder in beside}:
        raise InputError(
            f"--output: {table} would be replaced, which lies beside the frames as true poses do "
            "and is of no earlier run; give another folder."
        )
