"""Writes a whole small data set in BOP's layout: models, images, truth, targets.

Never renders: pictures, poses and visible fractions are given.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..geometry.camera import Camera
from ..geometry.mesh import Mesh
from ..io import read_json, read_json_list, replacing, write_json
from .bop import TARGETS, Instance
from .bop_layout import TESTED, scene_folders
from .mesh_writers import write_ply
from .video import Image
from .writer_checks import check_no_lens, write_shared_mesh

LEAST_VISIBLE = 0.1  # instances that are seen less are no targets (enumerate_test_targets.py)
DEPTH_SCALES = (0.1, 1.0)  # a step of a depth image in millimetres: the first that reaches, or last
MOST_STEPS = 65535


@dataclass(frozen=True, eq=False)
class BopImage:
    """One image of a scene: RGB (H, W, 3), its camera and true poses, depth (H, W) in metres.

    Files hold depth to 65.5 m; what is farther, below 0 or not finite is 0 there: unknown.
    """

    scene: int
    number: int
    image: Image
    camera: Camera
    truth: Sequence[Instance]
    depth: NDArray[np.float32] | None = None


def write_bop(
    root: str | Path, split: str, objects: Mapping[int, Mesh], images: Iterable[BopImage]
) -> Path:
    """Write models (PLY, models_info.json), a split and its targets; returns `root`.

    Scenes are written one after the other as they come; `scene_gt_info.json` holds `visib_fract`
    and, of instances that have a box, `bbox_visib`: the rest belongs to masks.

    Models that are there stay, as do other splits and the targets of scenes that are not written.
    `test_targets_bop19.json` names scenes of a test split only; of any other split all that is
    visible is to be found. `InputError` for a camera with a lens, which `cam_K` cannot hold, for
    another mesh than the one that is there and for a second test split beside those targets.
    """
    root = Path(root)
    if split.startswith(TESTED):
        _check_targets(root, split)
    write_models(root / "models", objects)
    counts: dict[tuple[int, int, int], int] = {}
    scenes: dict[int, dict[str, dict[str, Any]]] = {}
    for one in images:
        kept = scenes.setdefault(one.scene, {"camera": {}, "gt": {}, "gt_info": {}})
        _add(root / split / f"{one.scene:06d}", one, kept)
        for instance in one.truth:
            if instance.visible_fraction >= LEAST_VISIBLE:
                key = (one.scene, one.number, instance.object)
                counts[key] = counts.get(key, 0) + 1
    for scene, kept in scenes.items():
        for name, content in kept.items():
            write_json(root / split / f"{scene:06d}" / f"scene_{name}.json", content)
    if split.startswith(TESTED):
        _write_targets(root / TARGETS, counts, scenes)
    return root


def write_models(folder: str | Path, objects: Mapping[int, Mesh]) -> None:
    """PLY files in millimetres and models_info.json with diameters, boxes and symmetries.

    What is there stays; `InputError`, before anything is written, for an object that is there with
    another mesh or other symmetries.
    """
    folder = Path(folder)
    paths = {number: folder / f"obj_{number:06d}.ply" for number in objects}
    there = {number for number, path in paths.items() if path.is_file()}
    for number in there:
        write_shared_mesh(paths[number], objects[number], write_ply, "mm")
    known = folder / "models_info.json"
    infos = read_json(known) if known.is_file() else {}
    for number, mesh in objects.items():
        if number not in there:  # without a file of symmetries: BOP keeps them in models_info.json
            write_ply(paths[number], mesh, "mm")
        if number not in there or str(number) not in infos:
            infos[str(number)] = _info(mesh)
    write_json(known, infos)


def _info(mesh: Mesh) -> dict[str, Any]:
    """The entry of models_info.json: millimetres."""
    points = 1000 * (mesh.vertices.astype(np.float64) + mesh.center)
    low, size = points.min(0).tolist(), np.ptp(points, axis=0).tolist()
    info: dict[str, Any] = {"diameter": 1000 * mesh.diameter}
    info |= {f"min_{axis}": low[k] for k, axis in enumerate("xyz")}
    info |= {f"size_{axis}": size[k] for k, axis in enumerate("xyz")}
    return info | mesh.symmetries.to_bop()


def _check_targets(root: Path, split: str) -> None:
    """`InputError` where the targets that are there are those of another split."""
    if not (root / TARGETS).is_file():
        return
    others = (path for path in sorted(root.glob(f"{TESTED}*")) if path.is_dir())
    for other in others:
        if other.name != split and scene_folders(other):
            raise InputError(
                f"{root / TARGETS} lists the targets of the split {other.name!r}; write {split!r} "
                "into a folder of its own."
            )


def _write_targets(
    path: Path, counts: Mapping[tuple[int, int, int], int], scenes: Mapping[int, Any]
) -> None:
    """What is visible in the scenes written; the targets of other scenes stay."""
    targets = [
        {"im_id": image, "inst_count": count, "obj_id": number, "scene_id": scene}
        for (scene, image, number), count in sorted(counts.items())
    ]
    old = read_json_list(path) if path.is_file() else []
    kept = [one for one in old if isinstance(one, dict) and one.get("scene_id") not in scenes]
    with replacing(path) as temporary:
        temporary.write_text(json.dumps(kept + targets) + "\n", encoding="utf-8")


def _add(folder: Path, one: BopImage, kept: dict[str, dict[str, Any]]) -> None:
    """Write an image and its depth, and keep what the scene's files will say of it."""
    from PIL import Image as Pillow

    check_no_lens(one.camera, f"{folder}: image {one.number}: scene_camera.json")
    key, name = str(one.number), f"{one.number:06d}.png"
    (folder / "rgb").mkdir(parents=True, exist_ok=True)
    Pillow.fromarray(one.image).save(folder / "rgb" / name, compress_level=3)
    kept["camera"][key] = {"cam_K": one.camera.matrix.reshape(9).tolist()}
    if one.depth is not None:
        (folder / "depth").mkdir(exist_ok=True)
        steps, scale = _depth_steps(one.depth)
        Pillow.fromarray(steps).save(folder / "depth" / name)
        kept["camera"][key]["depth_scale"] = scale
    kept["gt"][key] = [
        {
            "cam_R_m2c": instance.pose.rotation.reshape(9).tolist(),
            "cam_t_m2c": (1000 * instance.pose.translation).tolist(),
            "obj_id": instance.object,
        }
        for instance in one.truth
    ]
    kept["gt_info"][key] = [
        {"visib_fract": instance.visible_fraction}
        | ({} if instance.box is None else {"bbox_visib": list(instance.box)})
        for instance in one.truth
    ]


def _depth_steps(depth: NDArray[np.float32]) -> tuple[NDArray[np.uint16], float]:
    """Depth in steps of the scale that is returned, millimetres; 0 where it does not fit."""
    known = np.where(np.isfinite(depth), depth, 0)
    for scale in DEPTH_SCALES:
        steps = np.rint(known * (1000 / scale))
        if steps.max(initial=0) <= MOST_STEPS:
            break
    fits = (steps >= 0) & (steps <= MOST_STEPS)
    return np.where(fits, steps, 0).astype(np.uint16), scale
