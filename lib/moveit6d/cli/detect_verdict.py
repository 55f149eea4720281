"""What `moveit6d detect --image` says at its end: what was found, and if nothing, why perhaps.

Never searches and never writes files.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import InputError
from .common import NOT_FOUND
from .detect_answers import Answer, pose_file
from .detect_search import OF_ONE
from .earlier import TABLE
from .messages import note
from .narrowing import advice as what_narrows

if TYPE_CHECKING:
    from ..geometry.mesh import Mesh


def verdict(
    args: argparse.Namespace,
    names: Sequence[str],
    meshes: Sequence[Mesh],
    answers: Sequence[Sequence[Answer]],
) -> int:
    """Print what was found; the exit code, or `InputError` if no image could be used.

    `answers` are those of each image, one an object.
    """
    if all(one.error for image in answers for one in image):
        raise InputError(f"no image could be used; the first says: {answers[0][0].error}")
    objects = [[image[k] for image in answers] for k in range(len(names))]
    missing = [k for k, some in enumerate(objects) if not any(one.found for one in some)]
    if len(names) > 1:
        for line in _of_several(args, names, answers):
            print(line)
    if len(missing) == len(names):
        print(f"moveit6d: {_nothing(args, meshes, answers)}.", file=sys.stderr)
        return NOT_FOUND
    if len(names) == 1:
        print(_of_one(args, objects[0]))
    elif missing:
        lost = ", ".join(names[k] for k in missing)
        hint = advice(args, [meshes[k] for k in missing])
        note(f"not found{' in any image' if len(answers) > 1 else ''}: {lost}{hint}.")
    return 0


def _of_one(args: argparse.Namespace, answers: Sequence[Answer]) -> str:
    """What was found of the only object."""
    if len(answers) > 1:
        return f"{_in_images(args, answers)}: {args.output / TABLE}"
    count = "" if args.instances == 1 else f"{_found(args, answers[0])}, "
    return f"{count}{_probabilities(answers[0])}: {_files(args, '', answers[0])}"


def _of_several(
    args: argparse.Namespace, names: Sequence[str], answers: Sequence[Sequence[Answer]]
) -> list[str]:
    """A sentence for each object in each image, and for each object in all of them."""
    lines = []
    for path, image in zip(args.image, answers, strict=True):
        for name, one in zip(names, image, strict=True):
            if one.error:  # a note has told
                continue
            if not one.found:
                lines.append(f"{name}: not found in {path.name} ({_best([one])})")
                continue
            text = f"{name}: {_found(args, one)} in {path.name}, {_probabilities(one)}"
            single = len(answers) == 1
            lines.append(f"{text}: {_files(args, name, one)}" if single else text)
    if len(answers) > 1:
        for k, name in enumerate(names):
            text = _in_images(args, [image[k] for image in answers])
            lines.append(f"{name}: {text}: {args.output / TABLE}")
    return lines


def _in_images(args: argparse.Namespace, answers: Sequence[Answer]) -> str:
    """In how many images an object was found; what was only clicked is not counted as found."""
    found = [one for one in answers if one.found]
    clicked = sum(one.clicked for one in answers)
    count = ""
    if args.instances > 1:
        instances = sum(len(one.poses) for one in found)
        count = f"{instances} instance{'' if instances == 1 else 's'} "
    text = f"found {count}in {len(found)} of {len(answers)} images"
    more = "more " if found else ""
    return f"{text}; the pose clicked in {clicked} {more}is not confirmed" if clicked else text


def _found(args: argparse.Namespace, answer: Answer) -> str:
    if args.instances == 1:
        return "found"
    return f"found {len(answer.poses)} of {args.instances} instances"


def _probabilities(answer: Answer) -> str:
    return f"probability {', '.join(f'{probability:.2f}' for _, probability, *_ in answer.poses)}"


def _best(answers: Sequence[Answer]) -> str:
    return f"probability of the best pose {max(one.best for one in answers):.2f}"


def _files(args: argparse.Namespace, name: str, answer: Answer) -> str:
    places = (args.output / pose_file(name, number) for number in range(len(answer.poses)))
    return ", ".join(map(str, places))


def _nothing(
    args: argparse.Namespace, meshes: Sequence[Mesh], answers: Sequence[Sequence[Answer]]
) -> str:
    """That nothing was found, how near it was, and what may help."""
    every = [one for image in answers for one in image]
    where = str(args.image[0]) if len(answers) == 1 else f"{len(answers)} images"
    what = "the object was" if len(meshes) == 1 else "the objects were"
    text = f"{where}: {what} not found ({_best(every)})"
    clicked = sum(one.clicked for one in every)
    if clicked:
        images = "" if len(answers) == 1 else f" in {clicked} images"
        file: Path = args.output / (pose_file("", 0) if len(answers) == 1 else TABLE)
        text += f"; the pose as clicked{images} is not confirmed: {file}"
    return text + advice(args, meshes)


def advice(args: argparse.Namespace, meshes: Sequence[Mesh]) -> str:
    """Why a search may have found nothing and what could help, as the end of a sentence."""
    text = _colours(args, [mesh.name for mesh in meshes if not mesh.has_colours])
    if len(args.mesh) > 1:
        distance = "narrow the search by" if args.distance is None else "check"
        *some, last = (f"--{name}" for name in OF_ONE)
        of_one = f"{', '.join(some)} or {last}"
        return f"{text}; {distance} --distance, or look for one object alone with {of_one}"
    if args.points is not None:
        return f"{text}; check --points by what the overlay shows"
    return text if args.method == "seeds" else text + what_narrows(args)


def _colours(args: argparse.Namespace, plain: Sequence[str]) -> str:
    """That meshes have no colours, by which a search goes, and how to do without."""
    if not plain:
        return ""
    have = "has" if len(plain) == 1 else "have"
    track = "`moveit6d track --texture_from_start`"
    remedy = f"{track} paints it at a pose that fits the image"
    if args.points is None:
        alone = " for one object alone," if len(args.mesh) > 1 else ","
        remedy = f"give --points{alone} which need none, and {track} paints it"
    return f"; {', '.join(plain)} {have} no colours, which is a likely reason: {remedy}"
