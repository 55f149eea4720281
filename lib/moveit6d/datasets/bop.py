"""Data sets in BOP's scene-wise layout and result files in BOP's format.

Never scores and never renders. BOP's millimetres become metres when reading and millimetres again
when writing. Layout: thodan/bop_toolkit docs/bop_datasets_format.md. Published quirks: rotations
of four LM-O objects are not quite orthonormal and are projected; intrinsics may differ from image
to image; `visib_fract` counts the parts outside of the image as hidden.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..geometry.camera import Camera
from ..geometry.mesh import Mesh
from ..geometry.pose import Pose
from ..geometry.symmetry import Symmetries
from ..io import read_json, read_json_list, replacing
from .video import Image, read_image

RESULT_HEADER = ("scene_id", "im_id", "obj_id", "score", "R", "t", "time")
MODEL_FOLDERS = ("models", "models_cad", "models_eval", "models_reconst")
SUFFIXES = (".png", ".jpg", ".tif", ".jpeg")
TARGETS = "test_targets_bop19.json"


@dataclass(frozen=True)
class Estimate:
    """One line of a BOP result file: a pose (metres) with its score; `seconds` is −1 if unknown.

    `seconds` is the time of the whole image, the same on all lines of that image.
    """

    scene: int
    image: int
    object: int
    score: float
    pose: Pose
    seconds: float = -1.0


@dataclass(frozen=True)
class Instance:
    """One true pose in one image (metres).

    `visible_fraction` is the share of the silhouette that is seen, 1 where nothing says otherwise.
    """

    object: int
    pose: Pose
    visible_fraction: float = 1.0


@dataclass(frozen=True)
class BopTarget:
    """What is to be estimated: `count` instances of an object in an image.

    Both are None in the targets of BOP24's detection tasks, which name images only.
    """

    scene: int
    image: int
    object: int | None
    count: int | None


@dataclass
class BopDataset:
    """One split of a data set: `root/split/<scene>/…` and `root/models`.

    `sensor` is the suffix of data sets with several cameras: `scene_gt_cam1.json`, `rgb_cam1/` or,
    for HOT3D, `scene_gt_gray1.json`, `gray1/`.
    """

    root: Path
    split: str
    sensor: str = ""
    _scenes: dict[tuple[int, str], dict[str, Any]] = field(default_factory=dict, repr=False)
    _meshes: dict[Path, Mesh] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        if not self.root.is_dir():
            raise InputError(f"{self.root} is not a folder; a BOP data set was expected there.")
        if not (self.root / self.split).is_dir():
            there = sorted(
                p.name for p in self.root.iterdir() if p.is_dir() and not p.name.startswith("model")
            )
            other = any(self.root.glob("data/*/*-meta.mat"))
            raise InputError(
                f"{self.root} has no split {self.split!r}; folders there: "
                f"{', '.join(there) or 'none'}."
                + " This is YCB-Video as published, not BOP's: open it as kind ycbv."
                * other
            )

    def scenes(self) -> list[int]:
        """Scene numbers of the split, sorted."""
        names = [p.name for p in (self.root / self.split).iterdir() if p.is_dir()]
        return sorted(int(name) for name in names if name.isdecimal())

    def images(self, scene: int) -> list[int]:
        """Image numbers of a scene, sorted."""
        return sorted(int(key) for key in self._scene(scene, "scene_camera"))

    def image(self, scene: int, image: int) -> Image:
        """One colour image, RGB (H, W, 3) uint8."""
        return read_image(self.image_path(scene, image))

    def depth(self, scene: int, image: int) -> NDArray[np.float32] | None:
        """Depth (H, W) along the viewing axis in metres, 0 where unknown; None without a file."""
        from PIL import Image as Pillow

        path = self._find(scene, image, ("depth",))
        if path is None:
            return None
        scale = float(self._camera_entry(scene, image)[0].get("depth_scale", 1.0))
        try:
            with Pillow.open(path) as opened:
                return np.asarray(opened).astype(np.float32) * np.float32(scale / 1000)
        except (OSError, ValueError) as error:
            raise InputError(f"{path} is not a readable depth image: {error}.") from error

    def check_image(self, scene: int, image: int) -> None:
        """`InputError` unless the image's file and intrinsics are there; opens neither."""
        self.image_path(scene, image)
        self.camera(scene, image, size=(1, 1))

    def camera(self, scene: int, image: int, size: tuple[int, int] | None = None) -> Camera:
        """The camera of one image; `size` (width, height) saves opening it."""
        entry, where = self._camera_entry(scene, image)
        values = entry.get("cam_K")
        if "cam_model" in entry:
            raise InputError(
                f"{where}: image {image} has a cam_model, a lens that is no pinhole; undistort the "
                "images and give cam_K."
            )
        if not isinstance(values, list) or len(values) != 9:
            raise InputError(f"{where}: image {image} has no cam_K of 9 numbers.")
        if size is None:
            height, width = self.image(scene, image).shape[:2]
            size = (width, height)
        return Camera(values[0], values[4], values[2], values[5], *size, skew=values[1])

    def truth(self, scene: int, image: int) -> list[Instance]:
        """The true poses of an image in the order of `scene_gt.json`."""
        known = self._scene(scene, "scene_gt")
        where = f"{self._json(scene, 'scene_gt')}, image {image}"
        if str(image) not in known:
            raise InputError(f"{where}: not there.")
        entries = known[str(image)]
        seen = [1.0] * len(entries)
        if self._json(scene, "scene_gt_info").is_file():
            info = self._scene(scene, "scene_gt_info").get(str(image), [])
            if len(info) != len(entries):
                raise InputError(f"{where}: scene_gt_info lists {len(info)} of {len(entries)}.")
            seen = [float(entry.get("visib_fract", 1.0)) for entry in info]
        return [
            Instance(
                int(entry["obj_id"]),
                _metres(entry["cam_R_m2c"], entry["cam_t_m2c"], where),
                visible,
            )
            for entry, visible in zip(entries, seen, strict=True)
        ]

    def targets(self, name: str = TARGETS) -> list[BopTarget]:
        """What a targets file asks for, in its order."""
        path = self.root / name
        try:
            return [
                BopTarget(
                    int(entry["scene_id"]),
                    int(entry["im_id"]),
                    entry.get("obj_id"),
                    entry.get("inst_count"),
                )
                for entry in read_json_list(path)
            ]
        except (KeyError, TypeError) as error:
            raise InputError(f"{path}: a target needs scene_id and im_id ({error}).") from None

    def model_info(self, number: int) -> Mapping[str, Any]:
        """What models_info.json says of an object: diameter in millimetres, symmetries, …."""
        path = self._models() / "models_info.json"
        known = _read_cached(path)
        if str(number) not in known:
            there = ", ".join(sorted(known, key=int))
            raise InputError(f"{path} does not know object {number}; it knows {there}.")
        info: Mapping[str, Any] = known[str(number)]
        return info

    def diameter(self, number: int) -> float:
        """The published diameter of an object, metres."""
        return float(self.model_info(number)["diameter"]) / 1000

    def is_symmetric(self, number: int) -> bool:
        """Whether models_info.json declares any symmetry of the object."""
        info = self.model_info(number)
        return bool(info.get("symmetries_discrete") or info.get("symmetries_continuous"))

    def mesh(self, number: int) -> Mesh:
        """The mesh of an object with its declared symmetries, for rendering; read once."""
        return self._mesh(self._models(), number)

    def eval_mesh(self, number: int) -> Mesh:
        """The mesh that BOP measures errors with, of models_eval where it is there; read once."""
        folder = self.root / "models_eval"
        there = (folder / f"obj_{number:06d}.ply").exists()
        return self._mesh(folder if there else self._models(), number)

    def mesh_path(self, number: int) -> Path:
        """Where the mesh of an object lies."""
        return self._models() / f"obj_{number:06d}.ply"

    def symmetries(self, number: int) -> Symmetries:
        """The declared symmetries of an object, metres."""
        return Symmetries.from_bop(self.model_info(number))

    def image_path(self, scene: int, image: int) -> Path:
        """The file of one colour (or grey) image."""
        path = self._find(scene, image, ("rgb", "gray"))
        if path is None:
            name = self._folder(scene) / (f"rgb_{self.sensor}" if self.sensor else "rgb")
            raise InputError(
                f"image {image} of scene {scene}: there is no {name}/{image:06d}.png or .jpg."
            )
        return path

    def _find(self, scene: int, image: int, kinds: tuple[str, ...]) -> Path | None:
        folder = self._folder(scene)
        names = [f"{kind}_{self.sensor}" if self.sensor else kind for kind in kinds]
        if self.sensor and "depth" not in kinds:
            names.append(self.sensor)
        places = (folder / name / f"{image:06d}{suffix}" for name in names for suffix in SUFFIXES)
        return next((place for place in places if place.exists()), None)

    def _mesh(self, folder: Path, number: int) -> Mesh:
        path = folder / f"obj_{number:06d}.ply"
        if path not in self._meshes:
            symmetries = self.symmetries(number)
            if not path.exists():
                raise InputError(f"object {number}: there is no mesh {path}.")
            self._meshes[path] = Mesh.load(path, unit="mm", symmetries=symmetries)
        return self._meshes[path]

    def _camera_entry(self, scene: int, image: int) -> tuple[dict[str, Any], str]:
        """What scene_camera.json says of an image, and the name of that file."""
        where = str(self._json(scene, "scene_camera"))
        known = self._scene(scene, "scene_camera")
        if str(image) not in known:
            raise InputError(f"{where} does not know image {image}.")
        return known[str(image)], where

    def _json(self, scene: int, name: str) -> Path:
        return self._folder(scene) / f"{name}{f'_{self.sensor}' if self.sensor else ''}.json"

    def _models(self) -> Path:
        for name in MODEL_FOLDERS:
            if (self.root / name / "models_info.json").exists():
                return self.root / name
        raise InputError(
            f"{self.root} has no models: looked for models_info.json in {', '.join(MODEL_FOLDERS)}."
        )

    def _folder(self, scene: int) -> Path:
        folder = self.root / self.split / f"{scene:06d}"
        if not folder.is_dir():
            there = ", ".join(map(str, self.scenes())) or "none"
            raise InputError(f"scene {scene}: no folder {folder}; scenes there: {there}.")
        return folder

    def _scene(self, scene: int, name: str) -> dict[str, Any]:
        if (scene, name) not in self._scenes:
            self._scenes[scene, name] = read_json(self._json(scene, name))
        return self._scenes[scene, name]


def read_results(path: Path) -> list[Estimate]:
    """All lines of a BOP result file in their order. An empty file is an `InputError`."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = list(csv.reader(file))
    except FileNotFoundError:
        raise InputError(f"{path} does not exist.") from None
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path} cannot be read: {error}.") from error
    if not rows or tuple(cell.strip() for cell in rows[0]) != RESULT_HEADER:
        raise InputError(f"{path}: its first line must be {','.join(RESULT_HEADER)}.")
    found = [_estimate(row, f"{path}, row {n}") for n, row in enumerate(rows[1:], 1) if row]
    if not found:
        raise InputError(f"{path} holds no estimate.")
    return found


def write_results(path: Path, estimates: Iterable[Estimate]) -> None:
    """Write a BOP result file, atomically, in the order given."""
    with replacing(path) as temporary, temporary.open("w", encoding="utf-8") as file:
        file.write(",".join(RESULT_HEADER) + "\n")
        for e in estimates:
            rotation = " ".join(f"{value:.10g}" for value in e.pose.rotation.reshape(9).tolist())
            shift = " ".join(f"{1000 * value:.10g}" for value in e.pose.translation.tolist())
            seconds = "-1" if e.seconds < 0 else f"{e.seconds:.6f}"
            file.write(
                f"{e.scene},{e.image},{e.object},{e.score:.6f},{rotation},{shift},{seconds}\n"
            )


def by_image(estimates: Iterable[Estimate]) -> Iterator[tuple[tuple[int, int], list[int]]]:
    """Row numbers (from 0) of every (scene, image), in order of first appearance."""
    places: dict[tuple[int, int], list[int]] = {}
    for index, estimate in enumerate(estimates):
        places.setdefault((estimate.scene, estimate.image), []).append(index)
    yield from places.items()


def _estimate(row: list[str], where: str) -> Estimate:
    if len(row) != len(RESULT_HEADER):
        raise InputError(f"{where}: {len(RESULT_HEADER)} fields expected, found {len(row)}.")
    try:
        scene, image, number = (int(cell) for cell in row[:3])
        score, seconds = float(row[3]), float(row[6])
        rotation = [float(cell) for cell in row[4].split()]
        shift = [float(cell) for cell in row[5].split()]
    except ValueError as error:
        raise InputError(f"{where}: {error}.") from None
    if not math.isfinite(score):
        raise InputError(f"{where}: the score must be a finite number, found {row[3]}.")
    return Estimate(scene, image, number, score, _metres(rotation, shift, where), seconds)


def _metres(rotation: Any, millimetres: Any, where: str) -> Pose:
    if len(rotation) != 9 or len(millimetres) != 3:
        raise InputError(
            f"{where}: R must have 9 numbers and t 3, found {len(rotation)} and {len(millimetres)}."
        )
    return Pose.checked(rotation, [value / 1000 for value in millimetres], where=where)


@lru_cache(maxsize=16)
def _read_cached(path: Path) -> dict[str, Any]:
    return read_json(path)
