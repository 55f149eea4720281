"""What verbs that track several objects share: their meshes, units, starts and names.

Never tracks.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import InputError
from .messages import detail, note
from .narrowing import LOOK_FOR_IT

if TYPE_CHECKING:
    from ..geometry.mesh import Mesh
    from ..geometry.pose import Pose


def load_meshes(args: argparse.Namespace) -> list[Mesh]:
    """The meshes of --mesh, each in its unit or all in the one that is given."""
    from ..geometry.mesh import Mesh

    units = args.mesh_unit
    if len(units) not in (1, len(args.mesh)):
        raise InputError(
            f"{len(args.mesh)} times --mesh but {len(units)} times --mesh_unit; give one unit, or "
            "one for each mesh."
        )
    units = units * len(args.mesh) if len(units) == 1 else units
    plain = args.allow_untextured or getattr(args, "texture_from_start", False)
    meshes = [
        Mesh.load(path, unit, allow_untextured=plain)
        for path, unit in zip(args.mesh, units, strict=True)
    ]
    for path, mesh in zip(args.mesh, meshes, strict=True):
        detail(f"mesh: {path}, {len(mesh.faces)} faces, {1000 * mesh.diameter:.1f} mm across")
    return meshes


def read_starts(args: argparse.Namespace, count: int) -> list[Pose | None]:
    """The poses of --start, one a mesh; None where objects are to be looked for."""
    from ..geometry.pose import Pose

    given = args.start or [None] * count
    if args.exact_start and not all(given):
        whose = "the pose: give --start" if count == 1 else "all poses: give --start for each mesh"
        raise InputError(f"--exact_start needs {whose}.")
    if len(given) != count:
        raise InputError(
            f"{count} times --mesh but {len(given)} times --start; give one for each mesh "
            f"({LOOK_FOR_IT} for an object to look for), or leave out --start to look for all."
        )
    return [path and Pose.load(path) for path in given]


def object_names(paths: Sequence[Path]) -> list[str]:
    """Names for the column `object`, each once; none for one object.

    Names of files, of files of one name those of their folders; instances of one file are numbered.
    """
    if len(paths) == 1:
        return [""]
    files = [Path(os.path.abspath(path)) for path in paths]
    names = _names_of_files(list(dict.fromkeys(files)))
    found: list[str] = []
    for file in files:
        name = names[file]
        others = {*found, *(one for other, one in names.items() if other != file)}
        if files.count(file) > 1 or name in others:
            name = next(one for k in count(1) if (one := f"{name}_{k}") not in others)
        found.append(name)
    return found


def _names_of_files(files: Sequence[Path]) -> dict[Path, str]:
    """The stems of different files; where stems are the same their folders' names tell them apart.

    Those alone, if they are different ones and no other file's stem.
    """
    stems = [file.stem for file in files]
    folders = [file.parent.name for file in files if stems.count(file.stem) > 1]
    alone = all(folders) and len({*folders}) == len(folders) and not {*folders} & {*stems}
    names = {file: file.stem for file in files}
    for file in files:
        if stems.count(file.stem) > 1:
            folder = file.parent.name
            names[file] = folder if alone else f"{folder}_{file.stem}"
    return names


def note_without_colours(
    args: argparse.Namespace, meshes: Sequence[Mesh], remembered: bool = False
) -> None:
    """Say that meshes without colours could be painted, if they are not.

    `remembered`: their looks are learnt from keyframes, and nothing needs to be said.
    """
    plain = [mesh.name for mesh in meshes if not mesh.has_colours]
    if plain and not (args.texture_from_start or remembered):
        note(
            f"{', '.join(plain)} has no colours, which makes it hard to follow; with "
            "--texture_from_start it takes those of the first frame, with --keyframes.enabled true "
            "those of all confident ones."
        )
