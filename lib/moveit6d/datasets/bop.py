"""Data sets in BOP's scene-wise layout and result files in BOP's format.

Never scores and never renders. BOP's millimetres become metres when reading and millimetres again
when writing. Layout: thodan/bop_toolkit docs/bop_datasets_format.md. Published quirks: rotations
of four LM-O objects are not quite orthonormal and are projected; intrinsics may differ from image
to image; `visib_fract` counts the parts outside of the image as hidden.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..checks import entry, listed, mapping, numbers, whole
from ..checks import number as _number
from ..errors import InputError
from ..geometry.camera import Camera
from ..geometry.mesh import Mesh, Unit
from ..geometry.pose import Pose
from ..geometry.symmetry import Symmetries
from ..io import read_json, read_json_list
from .bop_layout import MODEL_FOLDERS, image_files, model_file, model_folders, scene_folders
from .bop_results import Estimate as Estimate
from .bop_results import by_image as by_image
from .bop_results import metric_pose
from .bop_results import read_results as read_results
from .bop_results import write_results as write_results
from .video import Image, read_image

TARGETS = "test_targets_bop19.json"
Box = tuple[float, float, float, float]  # left, top, width, height; pixels


@dataclass(frozen=True)
class Instance:
    """One true pose in one image (metres).

    `visible_fraction` is the share of the silhouette that is seen, 1 where nothing says otherwise;
    `box` is around what is seen, None where nothing is, or nothing says so.
    """

    object: int
    pose: Pose
    visible_fraction: float = 1.0
    box: Box | None = None


@dataclass(frozen=True)
class BopTarget:
    """What is to be estimated: `count` instances of an object in an image.

    Both are None in the targets of BOP24's detection tasks, which name images only.
    """

    scene: int
    image: int
    object: int | None
    count: int | None


class BopDataset:
    """One split of a data set: `root/split/<scene>/…` and `root/models`.

    `sensor` is the suffix of data sets with several cameras: `scene_gt_cam1.json`, `rgb_cam1/` or,
    for HOT3D, `scene_gt_gray1.json`, `gray1/`. `mesh_unit` is that of the models, millimetres in
    BOP.
    """

    def __init__(
        self, root: str | Path, split: str, sensor: str = "", mesh_unit: Unit = "mm"
    ) -> None:
        self.root, self.split, self.sensor, self.mesh_unit = Path(root), split, sensor, mesh_unit
        self._scenes: dict[tuple[int, str], dict[str, Any]] = {}
        self._meshes: dict[Path, Mesh] = {}
        self._listed: dict[Path, dict[int, Path]] = {}
        self._info: dict[str, Any] | None = None
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
                + " This is YCB-Video as published, not BOP's: `benchmark tracking --format ycbv` "
                'reads it, in Python open_dataset(..., kind="ycbv").' * other
            )

    def scenes(self) -> list[int]:
        """Scene numbers of the split, sorted."""
        return sorted(scene_folders(self.root / self.split))

    def images(self, scene: int) -> list[int]:
        """Image numbers of a scene, sorted."""
        keys = self._scene(scene, "scene_camera")
        odd = next((key for key in keys if not (key.isascii() and key.isdecimal())), None)
        if odd is not None:
            where = self._json(scene, "scene_camera")
            raise InputError(f"{where}: {odd[:40]!r} is no number of an image.")
        return sorted(int(key) for key in keys)

    def image(self, scene: int, image: int) -> Image:
        """One colour image, RGB (H, W, 3) uint8."""
        return read_image(self.image_path(scene, image))

    def depth(self, scene: int, image: int) -> NDArray[np.float32] | None:
        """Depth (H, W) along the viewing axis in metres, 0 where unknown; None without a file."""
        from PIL import Image as Pillow

        path = self._find(scene, image, ("depth",))
        if path is None:
            return None
        content, where = self._camera_entry(scene, image)
        scale = _number(content.get("depth_scale", 1.0), f"{where}: depth_scale of image {image}")
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
        content, where = self._camera_entry(scene, image)
        if "cam_model" in content:
            raise InputError(
                f"{where}: image {image} has a cam_model, a lens that is no pinhole; undistort the "
                "images and give cam_K."
            )
        values = numbers(content.get("cam_K"), 9, f"{where}: cam_K of image {image}")
        if size is None:
            height, width = self.image(scene, image).shape[:2]
            size = (width, height)
        return Camera(values[0], values[4], values[2], values[5], *size, skew=values[1])

    def has_truth(self, scene: int, image: int) -> bool:
        """Whether `scene_gt.json` lists an image, be it with no object."""
        return str(image) in self._scene(scene, "scene_gt")

    def truth(self, scene: int, image: int) -> list[Instance]:
        """The true poses of an image in the order of `scene_gt.json`."""
        known = self._scene(scene, "scene_gt")
        where = f"{self._json(scene, 'scene_gt')}, image {image}"
        if str(image) not in known:
            raise InputError(f"{where}: not there.")
        entries = [mapping(one, where) for one in listed(known[str(image)], where)]
        about, details = "", [dict[str, Any]()] * len(entries)
        if self._json(scene, "scene_gt_info").is_file():
            about = str(self._json(scene, "scene_gt_info"))
            info = listed(self._scene(scene, "scene_gt_info").get(str(image), []), about)
            if len(info) != len(entries):
                raise InputError(f"{where}: scene_gt_info lists {len(info)} of {len(entries)}.")
            details = [mapping(one, about) for one in info]
        return [
            Instance(
                whole(entry(one, "obj_id", where), f"{where}: obj_id"),
                metric_pose(entry(one, "cam_R_m2c", where), entry(one, "cam_t_m2c", where), where),
                _number(detail.get("visib_fract", 1.0), f"{about}: visib_fract"),
                _seen_box(detail, about),
            )
            for one, detail in zip(entries, details, strict=True)
        ]

    def targets(self, name: str = TARGETS) -> list[BopTarget]:
        """What a targets file asks for, in its order."""
        path = self.root / name
        return [_target(mapping(one, f"{path}: a target"), path) for one in read_json_list(path)]

    def model_info(self, number: int) -> Mapping[str, Any]:
        """What models_info.json says of an object: diameter in millimetres, symmetries, ….

        Nothing where there is no such file or it is silent about an object whose mesh is there.
        """
        path = self._models() / "models_info.json"
        known = self._known(path)
        if known.get(str(number)) is not None:
            return mapping(known[str(number)], f"{path}: object {number}")
        if model_file(path.parent, number) is None:
            there = ", ".join(sorted(known)) or "none"
            raise InputError(f"{path} does not know object {number}; it knows {there}.")
        return {}

    def _known(self, path: Path) -> Mapping[str, Any]:
        """Everything in models_info.json, which is read once."""
        if self._info is None:
            self._info = read_json(path) if path.exists() else {}
        return self._info

    def objects(self) -> list[int]:
        """Numbers of all objects of models_info.json, sorted; `InputError` if it names none."""
        path = self._models() / "models_info.json"
        found = sorted(int(number) for number in self._known(path) if number.isdecimal())
        if not found:
            raise InputError(f"{path} names no object; give a targets file that does.")
        return found

    def diameter(self, number: int) -> float:
        """The published diameter of an object, metres; measured on its mesh where none is given."""
        given = self.model_info(number).get("diameter")
        if given is None:
            return self.eval_mesh(number).diameter
        where = f"{self._models() / 'models_info.json'}: diameter of object {number}"
        diameter = _number(given, where) / 1000
        if diameter <= 0:
            raise InputError(f"{where} must be above 0, found {given}.")
        return diameter

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
        there = folder.is_dir() and model_file(folder, number) is not None
        return self._mesh(folder if there else self._models(), number)

    def mesh_path(self, number: int) -> Path:
        """Where the mesh of an object lies, or would lie."""
        folder = self._models()
        return model_file(folder, number) or folder / f"obj_{number:06d}.ply"

    def symmetries(self, number: int) -> Symmetries:
        """The declared symmetries of an object, metres."""
        try:
            return Symmetries.from_bop(self.model_info(number))
        except InputError as error:
            path = self._models() / "models_info.json"
            raise InputError(f"{path}: object {number}: {error}") from error

    def image_path(self, scene: int, image: int) -> Path:
        """The file of one colour (or grey) image."""
        path = self._find(scene, image, ("rgb", "gray"))
        if path is None:
            place = self.expected_path(scene, image).with_suffix("")
            raise InputError(f"image {image} of scene {scene}: there is no {place}.png or .jpg.")
        return path

    def expected_path(self, scene: int, image: int) -> Path:
        """The file of one colour (or grey) image or, where it is missing, its usual path."""
        name = f"rgb_{self.sensor}" if self.sensor else "rgb"
        usual = self.folder(scene) / name / f"{image:06d}.png"
        return self._find(scene, image, ("rgb", "gray")) or usual

    def _find(self, scene: int, image: int, kinds: tuple[str, ...]) -> Path | None:
        folder = self.folder(scene)
        names = [f"{kind}_{self.sensor}" if self.sensor else kind for kind in kinds]
        if self.sensor and "depth" not in kinds:
            names.append(self.sensor)
        for place in (folder / name for name in names):
            if place not in self._listed:
                self._listed[place] = image_files(place)
            path = self._listed[place].get(image)
            if path is not None and path.exists():
                return path
        return None

    def _mesh(self, folder: Path, number: int) -> Mesh:
        path = model_file(folder, number)
        if path is None:
            self.model_info(number)  # has the better words for an object that nobody knows
            raise InputError(
                f"object {number}: there is no mesh {folder / f'obj_{number:06d}.ply'}, nor one of "
                "another format."
            )
        if path not in self._meshes:
            symmetries = self.symmetries(number)
            self._meshes[path] = Mesh.load(path, self.mesh_unit, symmetries, allow_flat=True)
        return self._meshes[path]

    def _camera_entry(self, scene: int, image: int) -> tuple[dict[str, Any], str]:
        """What scene_camera.json says of an image, and the name of that file."""
        where = str(self._json(scene, "scene_camera"))
        known = self._scene(scene, "scene_camera")
        if str(image) not in known:
            raise InputError(f"{where} does not know image {image}.")
        return mapping(known[str(image)], f"{where}: image {image}"), where

    def _json(self, scene: int, name: str) -> Path:
        return self.folder(scene) / f"{name}{f'_{self.sensor}' if self.sensor else ''}.json"

    def _models(self) -> Path:
        for folder in model_folders(self.root):
            if (folder / "models_info.json").exists() or any(folder.glob("obj_*.*")):
                return folder
        raise InputError(
            f"{self.root} has no models: looked for obj_000001.ply and models_info.json in "
            f"{', '.join(MODEL_FOLDERS)}."
        )

    def folder(self, scene: int) -> Path:
        """The folder of a scene, its number padded with zeros or not."""
        folder = self.root / self.split / f"{scene:06d}"
        if folder.is_dir():
            return folder
        found = scene_folders(self.root / self.split)
        if scene not in found:
            there = ", ".join(map(str, sorted(found))) or "none"
            raise InputError(f"scene {scene}: no folder {folder}; scenes there: {there}.")
        return found[scene]

    def _scene(self, scene: int, name: str) -> dict[str, Any]:
        if (scene, name) not in self._scenes:
            self._scenes[scene, name] = read_json(self._json(scene, name))
        return self._scenes[scene, name]


def box_of(value: Any, where: str) -> Box:
    """A checked box, as BOP's files have them; `InputError` names the place."""
    x, y, width, height = numbers(value, 4, where)
    return x, y, width, height


def _seen_box(detail: Mapping[str, Any], where: str) -> Box | None:
    """`bbox_visib` of scene_gt_info.json, whose sizes are −1 where nothing is seen."""
    if "bbox_visib" not in detail:
        return None
    box = box_of(detail["bbox_visib"], f"{where}: bbox_visib")
    return box if min(box[2:]) > 0 else None


def _target(content: dict[str, Any], path: Path) -> BopTarget:
    scene, image = (entry(content, key, f"{path}: a target") for key in ("scene_id", "im_id"))
    item, count = content.get("obj_id"), content.get("inst_count")
    return BopTarget(
        whole(scene, f"{path}: scene_id"),
        whole(image, f"{path}: im_id"),
        None if item is None else whole(item, f"{path}: obj_id"),
        None if count is None else whole(count, f"{path}: inst_count"),
    )
