"""YCB-Video as published (yuxng/YCB_Video_toolbox, yuxng/PoseCNN), not BOP's re-made YCB-V.

Never scores. Layout: `data/0048/000001-color.png` with `000001-meta.mat`, `models/NAME/` with
`textured_simple.obj` and `points.xyz` (the evaluation points), `keyframe.txt`. All metres, OpenCV.

What official readers trip over: `cls_indexes` is uint8 (cast before arithmetic) and (N, 1) or (N,);
with one object MATLAB drops the last axis of `poses`; `vertmap` makes up nearly all of a file, so
only named variables are read; scenes from 60 on come from another camera. Images count from 1 in
names, from 0 in `Sequence`. The lens is not quite a pinhole, which everybody ignores.
"""

from __future__ import annotations

import logging
from collections.abc import Collection, Iterable, Mapping
from collections.abc import Sequence as List
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..checks import file_name
from ..errors import InputError
from ..geometry.camera import Camera
from ..geometry.mesh import Mesh
from ..geometry.pose import Pose
from ..geometry.symmetry_file import symmetries_beside
from ..io import read_text, replacing, replacing_folder
from .mat_file import read_mat
from .mesh_writers import write_obj
from .sequences import Sequence
from .video import Image, first_size
from .writer_checks import check_no_lens, write_shared_mesh

OBJECTS = (
    "002_master_chef_can", "003_cracker_box", "004_sugar_box", "005_tomato_soup_can",
    "006_mustard_bottle", "007_tuna_fish_can", "008_pudding_box", "009_gelatin_box",
    "010_potted_meat_can", "011_banana", "019_pitcher_base", "021_bleach_cleanser", "024_bowl",
    "025_mug", "035_power_drill", "036_wood_block", "037_scissors", "040_large_marker",
    "051_large_clamp", "052_extra_large_clamp", "061_foam_brick",
)  # fmt: skip
# The five of the literature (DenseFusion, in italics in the paper). BOP's list is another one.
SYMMETRIC = (
    "024_bowl", "036_wood_block", "051_large_clamp", "052_extra_large_clamp", "061_foam_brick",
)  # fmt: skip
CAMERAS = (
    Camera(1066.778, 1067.487, 312.9869, 241.3109, 640, 480),
    Camera(1077.836, 1078.189, 323.7872, 279.6921, 640, 480),  # scenes from 60 on
)
MESHES = ("textured_simple.obj", "textured.obj")
META = ("cls_indexes", "poses", "intrinsic_matrix")
POINTS = 2620  # evaluation points an object, as the published ones have

LOG = logging.getLogger("moveit6d")


def read_ycbv(path: str | Path, scenes: Iterable[int] | None = None) -> list[Sequence]:
    """One sequence an object and scene, named `0048.035_power_drill`, grouped by object.

    `scenes` are those of keyframe.txt (the test set) where it is there, else all. `truth` holds
    every frame of the video in which the object occurs, `keyframes` those that are scored. A
    warning says how many scenes and keyframes are not there, as after half a download.
    """
    path = Path(path)
    if not is_ycbv(path):
        raise InputError(_not_here(path))
    keyframes = read_keyframes(path)
    there = [int(p.name) for p in (path / "data").iterdir() if p.is_dir() and p.name.isdecimal()]
    wanted = set(scenes if scenes is not None else keyframes or there)
    names = object_names(path)
    found = [
        sequence
        for scene in sorted(wanted & set(there))
        for sequence in _read_scene(path, scene, names, keyframes.get(scene))
    ]
    if not found:
        raise InputError(
            f"{path}/data holds none of the scenes {', '.join(map(str, sorted(wanted)))}; "
            f"scenes there: {', '.join(map(str, sorted(there))) or 'none'}."
        )
    _warn_of_missing(path, wanted, there, keyframes)
    return found


def is_ycbv(path: str | Path) -> bool:
    """Whether YCB-Video's own layout lies at `path`."""
    return next((Path(path) / "data").glob("*/*-meta.mat"), None) is not None


def read_keyframes(path: str | Path) -> dict[int, list[int]]:
    """Numbers of the scored images (as in file names) by scene; empty without a keyframe.txt."""
    path = Path(path)
    places = [path / "keyframe.txt", path / "image_sets" / "keyframe.txt"]
    file = next((place for place in places if place.is_file()), None)
    found: dict[int, list[int]] = {}
    for line in read_text(file).split() if file is not None else ():
        scene, _, image = line.partition("/")
        if not (scene.isdecimal() and image.isdecimal() and len(scene) < 10 and len(image) < 10):
            raise InputError(f"{file}: {line[:40]!r} is no line like 0048/000001.")
        found.setdefault(int(scene), []).append(int(image))
    return found


def object_names(path: str | Path) -> tuple[str, ...]:
    """Names of the classes 1, 2, …: image_sets/classes.txt, or the 21 published ones."""
    file = Path(path) / "image_sets" / "classes.txt"
    if not file.is_file():
        return OBJECTS
    return tuple(file_name(name, str(file)) for name in read_text(file).split())


def read_meta(path: str | Path) -> dict[int, NDArray[np.float64]]:
    """The poses (3, 4) of one -meta.mat by class, metres."""
    path = Path(path)
    content = _load(path, META[:2])
    classes = np.asarray(content["cls_indexes"]).reshape(-1).astype(np.int64)
    poses = np.asarray(content["poses"], np.float64)
    poses = poses[..., None] if poses.ndim == 2 else poses
    if poses.shape != (3, 4, len(classes)):
        raise InputError(
            f"{path}: poses must be 3 × 4 × {len(classes)}, as many as cls_indexes, found "
            f"{poses.shape}."
        )
    return {int(number): poses[..., k] for k, number in enumerate(classes)}


def write_ycbv_scene(
    path: str | Path,
    scene: int,
    objects: Mapping[int, Mesh],
    camera: Camera,
    frames: Iterable[tuple[Image, Mapping[int, Pose]]],
    names: List[str] = OBJECTS,
    every: int = 1,
) -> Path:
    """Write `data/SCENE`, the models that are missing, classes.txt and lines of keyframe.txt.

    `objects` and the poses of a frame go by class, 1 for `names[0]`; every `every`-th frame is a
    keyframe. Frames are written as they come; the folder appears when all is there. `InputError`
    for a camera with a lens, which the format cannot hold, and if models or names of classes that
    are there, and belong to older scenes too, are others.
    """
    from PIL import Image as Pillow
    from scipy.io import savemat

    path = Path(path)
    place, count = path / "data" / f"{scene:04d}", 0
    check_no_lens(camera, f"{place}: YCB-Video's format")
    names = _shared_names(path, place, tuple(names))
    for number, mesh in objects.items():
        _write_model(path / "models" / names[number - 1], mesh)
    with replacing_folder(place) as folder:
        for image, poses in frames:
            count += 1
            stem = folder / f"{count:06d}"
            Pillow.fromarray(image).save(f"{stem}-color.png", compress_level=3)
            listed = [pose.matrix[:3].numpy() for pose in poses.values()]
            meta = {
                "cls_indexes": np.array(list(poses), np.uint8)[:, None],
                "poses": np.stack(listed, -1) if listed else np.empty((3, 4, 0)),
                "intrinsic_matrix": camera.matrix.numpy(),
                "factor_depth": np.array([[10000.0]]),
            }
            savemat(f"{stem}-meta.mat", meta, do_compression=True)
    (path / "image_sets").mkdir(exist_ok=True)
    with replacing(path / "image_sets" / "classes.txt") as temporary:
        temporary.write_text("\n".join(names) + "\n", encoding="utf-8")
    keyframes = read_keyframes(path)
    keyframes[scene] = list(range(1, count + 1, every))
    lines = [f"{s:04d}/{image:06d}\n" for s in sorted(keyframes) for image in keyframes[s]]
    with replacing(path / "keyframe.txt") as temporary:
        temporary.write_text("".join(lines), encoding="utf-8")
    return place


def _read_scene(
    path: Path, scene: int, names: tuple[str, ...], keyframes: list[int] | None
) -> list[Sequence]:
    folder = path / "data" / f"{scene:04d}"
    images = _images(folder)
    found: dict[int, dict[int, NDArray[np.float64]]] = {}
    place = {int(image.name[:6]): index for index, image in enumerate(images)}
    for index, image in enumerate(images):
        meta = image.with_name(f"{image.name[:6]}-meta.mat")
        for number, matrix in (read_meta(meta) if meta.is_file() else {}).items():
            found.setdefault(number, {})[index] = matrix
    camera = _camera(images, scene)
    scored = None if keyframes is None else [place[k] for k in keyframes if k in place]
    sequences = []
    for number, matrices in sorted(found.items()):
        if not 1 <= number <= len(names):
            raise InputError(f"{folder}: class {number} has no name; {len(names)} are known.")
        name = names[number - 1]
        stacked = np.stack(list(matrices.values()))
        poses = Pose.checked(stacked[..., :3], stacked[..., 3], where=f"{folder}, {name}")
        truth = {frame: poses[k] for k, frame in enumerate(matrices)}
        first = next(iter(truth))
        points = path / "models" / name / "points.xyz"
        mesh = _mesh(path, name)
        sequences.append(
            Sequence(
                name=f"{scene:04d}.{name}",
                folder=folder,
                mesh=mesh,
                frames=folder,
                camera=camera,
                start=truth[first],
                first=first,
                truth=truth,
                images=tuple(images),
                points=points if points.is_file() else None,
                group=name,
                object=name,
                symmetric=name in SYMMETRIC or not symmetries_beside(mesh).is_trivial,
                keyframes=None if scored is None else frozenset(scored) & truth.keys(),
            )
        )
    return sequences


def _warn_of_missing(
    path: Path, wanted: set[int], there: Collection[int], keyframes: Mapping[int, List[int]]
) -> None:
    """Say how many of the wanted scenes and of their keyframes are not there, and not scored."""
    scenes = wanted - set(there)
    listed = [(scene, image) for scene in wanted for image in keyframes.get(scene, ())]
    images = [
        (scene, image)
        for scene, image in listed
        if not (path / "data" / f"{scene:04d}" / f"{image:06d}-meta.mat").is_file()
    ]
    missing = [f"{len(scenes)} of {len(wanted)} scenes"] if scenes else []
    missing += [f"{len(images)} of {len(listed)} keyframes"] if images else []
    if missing:
        text = " and ".join(missing)
        LOG.warning("%s is not complete: %s are not there, and left out of figures", path, text)


def _images(folder: Path) -> list[Path]:
    """The images of a scene in the order of their numbers.

    One that is missing but has a -meta.mat keeps its place, as a frame with an error.
    """
    there = sorted(p for s in ("png", "jpg") for p in folder.glob(f"*-color.{s}"))
    if not there:
        raise InputError(f"{folder} holds no image; looked for 000001-color.png.")
    odd = next((image for image in there if not image.name[:6].isdecimal()), None)
    if odd is not None:
        raise InputError(f"{odd}: images are called 000001-color.png, with six digits.")
    known = {path.name[:6] for path in folder.glob("[0-9]" * 6 + "-meta.mat")}
    missing = known - {image.name[:6] for image in there}
    suffix = there[0].suffix
    return sorted([*there, *(folder / f"{number}-color{suffix}" for number in missing)])


def _camera(images: List[Path], scene: int) -> Camera:
    """Of the first image: as its meta.mat says, else by the number of the scene."""
    width, height = first_size(images)
    image = images[0]
    meta = image.with_name(f"{image.name[:6]}-meta.mat")
    k = np.asarray(_load(meta, META[2:]).get(META[2], ()), np.float64) if meta.is_file() else None
    if k is None or k.shape != (3, 3):
        return CAMERAS[scene >= 60].resize(width, height)
    return Camera(k[0, 0], k[1, 1], k[0, 2], k[1, 2], width, height, skew=k[0, 1])


def _load(path: Path, variables: tuple[str, ...]) -> dict[str, Any]:
    content: dict[str, Any] = read_mat(path, variables)
    missing = [name for name in variables if name not in content and name != META[2]]
    if missing:
        raise InputError(f"{path} has no variable {' and '.join(missing)}.")
    return content


def _mesh(path: Path, name: str) -> Path:
    for file in MESHES:
        if (path / "models" / name / file).is_file():
            return path / "models" / name / file
    raise InputError(f"{path}/models/{name} holds no mesh; looked for {', '.join(MESHES)}.")


def _write_model(folder: Path, mesh: Mesh) -> None:
    there = next((folder / name for name in MESHES if (folder / name).is_file()), None)
    write_shared_mesh(there or folder / MESHES[0], mesh, write_obj)
    if there is not None:
        return
    with replacing(folder / "points.xyz") as temporary:
        np.savetxt(temporary, mesh.sample_points(POINTS), fmt="%.6f")


def _shared_names(path: Path, place: Path, names: tuple[str, ...]) -> tuple[str, ...]:
    """Names of the classes for all scenes; `InputError` if those of older scenes are others."""
    if all(p == place for p in (path / "data").glob("[0-9]*")):
        return names
    known = object_names(path)
    for number, (old, new) in enumerate(zip(known, names, strict=False), 1):
        if old != new:
            raise InputError(
                f"{path / 'image_sets' / 'classes.txt'}: class {number} is {old} in the scenes "
                f"that are there and {new} in the one to write; give the same names in that order."
            )
    return max(known, names, key=len)


def _not_here(path: Path) -> str:
    wanted = f"{path} holds no YCB-Video data: looked for data/0048/000001-meta.mat"
    if any(path.glob("*/*/scene_gt.json")):
        return (
            f"{wanted}. This is BOP's YCB-V, with other models and frames: "
            '--format bop reads it, in Python open_dataset(..., kind="bop").'
        )
    return f"{wanted}."
