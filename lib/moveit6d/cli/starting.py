"""Where the objects of a video are when it begins: poses that are given, and a first search.

Never tracks.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import TYPE_CHECKING, Any

from .messages import note
from .narrowing import OF_ONE_FRAME, first_pose, is_narrowed, known_of
from .objects import object_names

if TYPE_CHECKING:
    from ..datasets.video import VideoFrame
    from ..estimation.detection import PoseDetector
    from ..geometry.mesh import Mesh
    from ..geometry.pose import Pose


@dataclass(frozen=True)
class Beginning:
    """What is known when a track begins, an entry an object.

    `starts` are the poses to begin from, None for objects that are to be looked for. `found` are
    the same after a search in `first`, the first frame that can be read; without one it is empty.
    `exact` says whether the pose is one of that frame: a given one is not where frames before it
    could not be read. `first` is None where nobody needed it, or no frame can be read.
    """

    starts: Sequence[Pose | None]
    exact: Sequence[bool]
    found: tuple[Pose | None, ...] = ()
    first: VideoFrame | None = None


def begin(
    args: argparse.Namespace,
    meshes: Sequence[Mesh],
    given: Sequence[Pose | None],
    frames: Iterator[VideoFrame],
    detector: Callable[[Mesh], PoseDetector],
    before: tuple[Pose | None, ...] = (),
) -> tuple[Beginning, Iterator[VideoFrame]]:
    """Where the objects are in the first frame that can be read, and all frames.

    It is searched where options say where to look in it, and for meshes that are to be painted
    there; in a distance that holds for the whole video the tracker looks by itself.
    `given` are the poses of --start; `before` is what a track that is gone on with has found.
    """
    narrowed = is_narrowed(args, OF_ONE_FRAME)
    searched = [
        number
        for number, (mesh, pose) in enumerate(zip(meshes, given, strict=True))
        if pose is None and (narrowed or _is_painted(args, mesh))
    ]
    if not searched and not any(_is_painted(args, mesh) for mesh in meshes):
        return Beginning(given, [pose is not None for pose in given]), frames
    first, unread, frames = first_readable(frames)
    found = before
    if searched and not found and first is not None:
        found = _found(args, meshes, given, searched, first, unread, detector)
    starts = list(found) or given
    exact = [
        pose is not None and first is not None and (given[number] is None or not unread)
        for number, pose in enumerate(starts)
    ]
    return Beginning(starts, exact, found, first), frames


def first_readable(
    frames: Iterator[VideoFrame],
) -> tuple[VideoFrame | None, int, Iterator[VideoFrame]]:
    """The first frame that can be read, if there is one, how many before cannot, and all frames."""
    seen = []
    for frame in frames:
        seen.append(frame)
        if frame.image is not None:
            return frame, len(seen) - 1, chain(seen, frames)
    return None, len(seen), iter(seen)


def _is_painted(args: argparse.Namespace, mesh: Mesh) -> bool:
    return bool(args.texture_from_start) and not mesh.has_colours


def _found(
    args: argparse.Namespace,
    meshes: Sequence[Mesh],
    given: Sequence[Pose | None],
    searched: Sequence[int],
    first: VideoFrame,
    unread: int,
    detector: Callable[[Mesh], PoseDetector],
) -> tuple[Pose | None, ...]:
    """The poses of all objects, of those that are `searched` by what the frame shows."""
    known, where = known_of(args, args.mesh_unit[0]), "the first frame"
    if unread:
        where = f"frame {first.index}"
        left_out = [f"--{name}" for name in OF_ONE_FRAME if known[name] is not None]
        which = "is" if len(left_out) == 1 else "are"
        without = f" without {' and '.join(left_out)}, which {which} of the first"
        note(
            f"the first frame cannot be read; {where} is searched"
            f"{without if left_out else ' instead'}."
        )
        known = {**known, **dict.fromkeys(OF_ONE_FRAME)}
    if len(meshes) == 1:
        return (first_pose(detector(meshes[0]), first, known, where),)
    found = _found_several(meshes, given, searched, first, known["distance"], detector)
    names = object_names(args.mesh)
    missing = [names[number] for number in searched if found[number] is None]
    if missing:
        note(f"not found in {where}, and looked for from there on: {', '.join(missing)}.")
    return found


def _found_several(
    meshes: Sequence[Mesh],
    given: Sequence[Pose | None],
    searched: Sequence[int],
    first: VideoFrame,
    distance: Any,
    detector: Callable[[Mesh], PoseDetector],
) -> tuple[Pose | None, ...]:
    """The poses of all objects: instances of one mesh are found together, beside given ones."""
    from ..estimation.detection import SearchRegion, detect_objects
    from ..estimation.detection.instances import same_meshes

    assert first.image is not None
    same = same_meshes(meshes)
    groups = [
        [number, *(k for k in same[number] if k in searched)]
        for number in searched
        if not any(k in searched and k < number for k in same[number])
    ]
    detectors = [detector(meshes[group[0]]) for group in groups]
    regions = []
    for group, one in zip(groups, detectors, strict=True):
        taken = (given[k] for k in same[group[0]])
        region = SearchRegion.checked(one.camera, distance=distance)
        regions.append(replace(region, taken=tuple(pose for pose in taken if pose is not None)))
    answers = detect_objects(detectors, first.image, [len(group) for group in groups], regions)
    found = list(given)
    for group, answer in zip(groups, answers, strict=True):
        for number, instance in zip(group, answer.instances, strict=False):
            found[number] = instance.pose
    return tuple(found)
