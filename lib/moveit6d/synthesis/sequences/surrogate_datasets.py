"""Synthetic data sets in the formats of published ones, for when those cannot be had.

Never takes the name of a real data set without the word surrogate: `surrogate.json` at the root
says what it is, `visible_fraction.csv` what can be seen of each object in each frame.
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

from ...datasets.catalog import SURROGATE
from ...datasets.laval import write_laval_sequence
from ...datasets.ycbv import CAMERAS, write_ycbv_scene
from ...errors import InputError
from ...geometry.camera import Camera
from ...geometry.mesh import Mesh
from ...geometry.pose import Pose
from ...io import read_json, refuse_foreign, replacing_folder, write_json
from ...typing import RGBImage
from .difficulty import Difficulty, find_difficulty
from .sequence import Scene, SyntheticFrame

OCCLUSIONS = (0, 15, 30, 45)  # per cent, the levels that the paper reports on Laval
VISIBLE = "visible_fraction.csv"
COLUMNS = ("sequence", "frame", "visible_fraction")
LAVAL_CAMERA = Camera(615.0, 615.0, 319.5, 239.5, 640, 480)
FIRST_SCENE = 48  # of the published test scenes
TABLETOP_MARGIN = 2.6  # of the middle object's radius: its neighbours are to be seen, too
KEYFRAMES = 5  # every so many frames of a scene; the published ones are about as dense
Watch = Callable[[str, int], None]  # name and number of a finished frame


@dataclass(frozen=True)
class GenerationOptions:
    """How a surrogate is made: `frames` a sequence, what moves and shines how, and from which seed.

    `photos` (H, W, 3) become backgrounds and textures; without them procedural pictures do.
    """

    frames: int = 120
    difficulty: str | Difficulty = "medium"
    seed: int = 0
    photos: Sequence[RGBImage] | None = None
    on_frame: Watch | None = None

    def facts(self) -> dict[str, Any]:
        """What is worth telling later."""
        return {
            "frames": self.frames,
            "difficulty": find_difficulty(self.difficulty).name,
            "seed": self.seed,
        }


def write_laval_surrogate(
    root: Path,
    objects: Mapping[str, Mesh],
    options: GenerationOptions,
    occlusions: Sequence[int] = OCCLUSIONS,
    camera: Camera = LAVAL_CAMERA,
) -> None:
    """Laval-like sequences: every object behind a board that hides 0, 15, … per cent of it.

    Named as in the data set, `OBJECT_occlusion_0`, `OBJECT_occlusion_h_15`, `…_v_15`; all of an
    object show the same motion before the same background. An older surrogate is replaced.
    """
    if not occlusions or not all(0 <= share < 100 for share in occlusions):
        raise InputError(f"occlusions are per cent from 0 to 99, found {list(occlusions)}.")
    about = {"what": "surrogate for Laval", **options.facts(), "occlusions": list(occlusions)}
    with _new_dataset(root, about) as (work, log):
        for order, (name, mesh) in enumerate(objects.items()):
            for side, share in laval_kinds(occlusions):
                base = find_difficulty(options.difficulty)
                difficulty = replace(
                    base, occluded_frames=(0, 0), board=side, board_occlusion=share / 100
                )
                seed = options.seed + order
                scene = Scene(mesh, seed, options.frames, difficulty, options.photos, camera)
                title = "_".join([name, "occlusion", *([side] if side else []), str(share)])
                rendered = log.watch(title, scene, options)
                frames = ((one.image, one.pose) for one in rendered)
                write_laval_sequence(work, title, mesh, camera, frames)


def laval_kinds(occlusions: Sequence[int]) -> list[tuple[Literal["", "h", "v"], int]]:
    """Side of the board and per cent of every sequence of an object, without a board for 0."""
    kinds: list[tuple[Literal["", "h", "v"], int]] = []
    for share in sorted(set(occlusions)):
        kinds += [("h", share), ("v", share)] if share else [("", 0)]
    return kinds


def write_ycbv_surrogate(
    root: Path,
    scenes: Sequence[Mapping[str, Mesh]],
    options: GenerationOptions,
    camera: Camera = CAMERAS[0],
) -> None:
    """YCB-Video-like scenes 48, 49, …: objects on a table before a moving camera.

    They hide each other now and then. Objects have their own names in `image_sets/classes.txt`.
    An older surrogate is replaced.
    """
    names = list(dict.fromkeys(name for objects in scenes for name in objects))
    about = {"what": "surrogate for YCB-Video", **options.facts(), "scenes": len(scenes)}
    with _new_dataset(root, about) as (work, log):
        for order, objects in enumerate(scenes):
            first, *others = objects.values()
            difficulty = replace(
                find_difficulty(options.difficulty), margin=TABLETOP_MARGIN, occluded_frames=(0, 0)
            )
            seed, number = options.seed + order, FIRST_SCENE + order
            scene = Scene(first, seed, options.frames, difficulty, options.photos, camera, others)
            rendered = log.watch(f"{number:04d}", scene, options, list(objects))
            classes = [names.index(name) + 1 for name in objects]
            frames = ((one.image, dict(zip(classes, _poses(one), strict=True))) for one in rendered)
            meshes = dict(zip(classes, objects.values(), strict=True))
            write_ycbv_scene(work, number, meshes, camera, frames, names, KEYFRAMES)


def object_name(mesh: Mesh) -> str:
    """A mesh's name as data sets write names: small letters, digits and underscores."""
    return re.sub(r"[^a-z0-9]+", "_", mesh.name.lower()).strip("_") or "object"


def _poses(one: SyntheticFrame) -> list[Pose]:
    return [one.pose, *(pose for pose, _ in one.others)]


class _VisibilityLog:
    """What can be seen of each object, taken down while frames pass."""

    def __init__(self) -> None:
        self.rows: list[tuple[str, int, float]] = []

    def watch(
        self, title: str, scene: Scene, options: GenerationOptions, names: Sequence[str] = ()
    ) -> Iterator[SyntheticFrame]:
        """The frames of a scene, one after the other."""
        titles = [f"{title}.{name}" for name in names] or [title]
        for number in range(options.frames):
            one = scene.render_frame(number)
            seen = [one.visible_fraction, *(fraction for _, fraction in one.others)]
            self.rows += [(t, number, s) for t, s in zip(titles, seen, strict=True)]
            yield one
            if options.on_frame is not None:
                options.on_frame(title, number)

    def means(self) -> dict[str, float]:
        """Mean visible fraction of every sequence."""
        shares: dict[str, list[float]] = {}
        for title, _, seen in self.rows:
            shares.setdefault(title, []).append(seen)
        return {title: round(float(np.mean(seen)), 4) for title, seen in shares.items()}


@contextmanager
def _new_dataset(root: Path, about: Mapping[str, Any]) -> Iterator[tuple[Path, _VisibilityLog]]:
    """A folder that becomes `root` when all is there, with the two files that say what it is."""
    if root.exists() and not root.is_dir():
        raise InputError(f"{root} is a file; a data set is a folder: give a new one.")
    if root.exists() and any(root.iterdir()) and not (root / SURROGATE).is_file():
        raise InputError(f"{root} exists and is not a data set made here; give a new folder.")
    _check_foreign(root)
    log = _VisibilityLog()
    with replacing_folder(root) as work:
        yield work, log
        holds = sorted([SURROGATE, VISIBLE, *(path.name for path in work.iterdir())])
        write_json(work / SURROGATE, {**about, "visible_fraction": log.means(), "holds": holds})
        with (work / VISIBLE).open("w", encoding="utf-8", newline="") as file:
            table = csv.writer(file, lineterminator="\n")
            table.writerow(COLUMNS)
            table.writerows((title, frame, f"{seen:.4f}") for title, frame, seen in log.rows)


def _check_foreign(root: Path) -> None:
    """`InputError` where an earlier data set, which would be replaced, says that something is new.

    One that does not say what it holds was made by an earlier version.
    """
    if not (root / SURROGATE).is_file():
        return
    there = sorted(path.name for path in root.iterdir())
    known = read_json(root / SURROGATE).get("holds", there)
    refuse_foreign(root, [name for name in there if name not in known], "a data set")
