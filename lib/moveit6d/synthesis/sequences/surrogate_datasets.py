"""Made data sets in the formats of published ones, for when those cannot be had.

Never takes the name of a real data set without the word stand-in: `stand_in.json` at the root says
what it is, and `visible_fraction.csv` what can be seen of each object in each frame.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ...datasets.catalog import STAND_IN
from ...datasets.laval import write_laval_sequence
from ...datasets.ycbv import CAMERAS, write_ycbv_scene
from ...errors import InputError
from ...geometry.camera import Camera
from ...geometry.mesh import Mesh
from ...geometry.pose import Pose
from ...io import replacing_folder, write_json
from .difficulty import Level, find_level
from .sequence import Scene, Shot

Picture = NDArray[np.uint8]
OCCLUSIONS = (0, 15, 30, 45)  # per cent, the levels that the paper reports on Laval
VISIBLE = "visible_fraction.csv"
COLUMNS = ("sequence", "frame", "visible_fraction")
LAVAL_CAMERA = Camera(615.0, 615.0, 319.5, 239.5, 640, 480)
FIRST_SCENE = 48  # of the published test scenes
TABLE_MARGIN = 2.6  # of the middle object's radius: its neighbours are to be seen, too
KEYFRAMES = 5  # every so many frames of a scene; the published ones are about as dense
Watch = Callable[[str, int], None]  # name and number of a finished frame


@dataclass(frozen=True)
class Making:
    """How a stand-in is made: `frames` a sequence, what moves and shines how, and from which seed.

    `photos` (H, W, 3) become backgrounds and prints; without them pictures made by code do.
    """

    frames: int = 120
    level: str | Level = "medium"
    seed: int = 0
    photos: Sequence[Picture] | None = None
    on_frame: Watch | None = None

    def facts(self) -> dict[str, Any]:
        """What is worth telling later."""
        return {"frames": self.frames, "level": find_level(self.level).name, "seed": self.seed}


def write_laval_stand_in(
    root: Path,
    objects: Mapping[str, Mesh],
    making: Making,
    occlusions: Sequence[int] = OCCLUSIONS,
    camera: Camera = LAVAL_CAMERA,
) -> None:
    """Laval-like sequences: every object behind a board that hides 0, 15, … per cent of it.

    Named as in the data set, `OBJECT_occlusion_0`, `OBJECT_occlusion_h_15`, `…_v_15`; all of an
    object show the same motion before the same background. An older stand-in is replaced.
    """
    if not occlusions or not all(0 <= share < 100 for share in occlusions):
        raise InputError(f"occlusions are per cent from 0 to 99, found {list(occlusions)}.")
    about = {"what": "stand-in for Laval", **making.facts(), "occlusions": list(occlusions)}
    with _made(root, about) as (work, notes):
        for order, (name, mesh) in enumerate(objects.items()):
            for side, share in laval_kinds(occlusions):
                base = find_level(making.level)
                level = replace(base, covered_frames=(0, 0), screen=side, screened=share / 100)
                seed = making.seed + order
                scene = Scene(mesh, seed, making.frames, level, making.photos, camera)
                title = "_".join([name, "occlusion", *([side] if side else []), str(share)])
                shots = notes.watch(title, scene, making)
                frames = ((shot.image, shot.pose) for shot in shots)
                write_laval_sequence(work, title, mesh, camera, frames)


def laval_kinds(occlusions: Sequence[int]) -> list[tuple[Literal["", "h", "v"], int]]:
    """Side of the board and per cent of every sequence of an object, without a board for 0."""
    kinds: list[tuple[Literal["", "h", "v"], int]] = []
    for share in sorted(set(occlusions)):
        kinds += [("h", share), ("v", share)] if share else [("", 0)]
    return kinds


def write_ycbv_stand_in(
    root: Path,
    scenes: Sequence[Mapping[str, Mesh]],
    making: Making,
    camera: Camera = CAMERAS[0],
) -> None:
    """YCB-Video-like scenes 48, 49, …: objects on a table before a moving camera.

    They hide each other now and then. Objects have their own names in `image_sets/classes.txt`.
    An older stand-in is replaced.
    """
    names = list(dict.fromkeys(name for objects in scenes for name in objects))
    about = {"what": "stand-in for YCB-Video", **making.facts(), "scenes": len(scenes)}
    with _made(root, about) as (work, notes):
        for order, objects in enumerate(scenes):
            first, *others = objects.values()
            level = replace(find_level(making.level), margin=TABLE_MARGIN, covered_frames=(0, 0))
            seed, number = making.seed + order, FIRST_SCENE + order
            scene = Scene(first, seed, making.frames, level, making.photos, camera, others)
            shots = notes.watch(f"{number:04d}", scene, making, list(objects))
            classes = [names.index(name) + 1 for name in objects]
            frames = ((shot.image, dict(zip(classes, _poses(shot), strict=True))) for shot in shots)
            meshes = dict(zip(classes, objects.values(), strict=True))
            write_ycbv_scene(work, number, meshes, camera, frames, names, KEYFRAMES)


def object_name(mesh: Mesh) -> str:
    """A mesh's name as data sets write names: small letters, digits and underscores."""
    return re.sub(r"[^a-z0-9]+", "_", mesh.name.lower()).strip("_") or "object"


def _poses(shot: Shot) -> list[Pose]:
    return [shot.pose, *(pose for pose, _ in shot.others)]


class _Notes:
    """What can be seen of each object, taken down while frames pass."""

    def __init__(self) -> None:
        self.rows: list[tuple[str, int, float]] = []

    def watch(
        self, title: str, scene: Scene, making: Making, names: Sequence[str] = ()
    ) -> Iterator[Shot]:
        """The frames of a scene, one after the other."""
        titles = [f"{title}.{name}" for name in names] or [title]
        for number in range(making.frames):
            shot = scene.shoot(number)
            seen = [shot.visible_fraction, *(fraction for _, fraction in shot.others)]
            self.rows += [(t, number, s) for t, s in zip(titles, seen, strict=True)]
            yield shot
            if making.on_frame is not None:
                making.on_frame(title, number)

    def means(self) -> dict[str, float]:
        """Mean visible fraction of every sequence."""
        shares: dict[str, list[float]] = {}
        for title, _, seen in self.rows:
            shares.setdefault(title, []).append(seen)
        return {title: round(float(np.mean(seen)), 4) for title, seen in shares.items()}


@contextmanager
def _made(root: Path, about: Mapping[str, Any]) -> Iterator[tuple[Path, _Notes]]:
    """A folder that becomes `root` when all is there, with the two files that say what it is."""
    if root.exists() and any(root.iterdir()) and not (root / STAND_IN).is_file():
        raise InputError(f"{root} exists and is not a data set made here; give a new folder.")
    notes = _Notes()
    with replacing_folder(root) as work:
        yield work, notes
        write_json(work / STAND_IN, {**about, "visible_fraction": notes.means()})
        with (work / VISIBLE).open("w", encoding="utf-8", newline="") as file:
            table = csv.writer(file, lineterminator="\n")
            table.writerow(COLUMNS)
            table.writerows((title, frame, f"{seen:.4f}") for title, frame, seen in notes.rows)
