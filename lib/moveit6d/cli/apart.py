"""What a run writes, kept apart from what it reads: no input is lost to an output.

Never writes or removes anything.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from ..errors import InputError
from ..io import check_writable
from .earlier import holds_results
from .journal import journal_file


def given_paths(args: argparse.Namespace, *written: str) -> Iterator[Path]:
    """The files and folders that the arguments name, but those of the options in `written`."""
    for name, value in vars(args).items():
        if name not in written:
            for one in value if isinstance(value, list) else [value]:
                if isinstance(one, Path):
                    yield one


def check_result(args: argparse.Namespace, *more: Path) -> None:
    """`InputError` where the result file of a BOP data set cannot be written, or destroys an input.

    `more` are inputs beside those that the arguments name as paths.
    """
    folders = [args.dataset / args.split, *args.dataset.glob("models*")]
    written = {"--output": (args.output, journal_file(args.output))}
    check_apart(written, [*given_paths(args, "output"), *more], folders)
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

    inputs = list(read)
    taken = {f"{path.resolve()}{os.sep}": "this run reads" for path in inputs}
    for mesh in inputs:
        if mesh.suffix.lower() in SUFFIXES and mesh.is_file():
            named = {f"{path.resolve()}{os.sep}": f"{mesh} names" for path in files_of_mesh(mesh)}
            taken = {**named, **taken}
    places = [folder.resolve() for folder in folders]
    for option, paths in written.items():
        given = [path for path in paths if path is not None]
        for path in given:
            place = path.resolve()
            why = _taken(place, taken, places)
            if why is not None:
                raise InputError(
                    f"{option}: {path} would be replaced, which {why}; give another name."
                )
        taken |= {f"{path.resolve()}{os.sep}": f"{option} writes" for path in given}


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


def _taken(place: Path, taken: Mapping[str, str], folders: Iterable[Path]) -> str | None:
    """Why nothing may be written in this place; None if it may."""
    for other, why in taken.items():
        if other.startswith(f"{place}{os.sep}"):
            return why
    if place.is_file() and any(folder in place.parents for folder in folders):
        return "this run reads"
    return None
