"""The Laval sequences ("A Framework for Evaluating 6-DOF Object Trackers", Garon et al. 2018).

Never scores. Layout and conventions are those of lvsn/6DOF_tracking_evaluation: a mesh
`OBJECT/geometry.ply` in metres; a folder `OBJECT_KIND` with `camera.json` (focalX …), `poses.npy`
(N × 16 or N × 4 × 4, the truth) and `0.png`, `1.png`, …. Poses are OpenGL's (y up, objects at
negative z), metres, turned to OpenCV's axes here and back when written.

Quirks of the official code, none of which is repeated here: its iterator runs one frame past the
end; its renderer puts the principal point at row H − centerY while `center_pixel` projects to
centerY (we do as the latter, which is OpenCV's); its texture rows are flipped for OpenGL, so that
the files follow the usual rule, v up. Its depth images (`0d.png`) are not read.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from ..checks import number, numbers, whole
from ..errors import InputError
from ..geometry.camera import Camera
from ..geometry.mesh import Mesh
from ..geometry.pose import Pose
from ..geometry.symmetry_file import symmetries_beside
from ..io import read_json, replacing, replacing_folder, write_json
from .mesh_writers import write_ply
from .sequences import Sequence
from .video import Image
from .writer_checks import check_no_skew, write_shared_mesh

OBJECTS = (
    "clock", "cookiejar", "dog", "dragon", "kinect", "lego", "shoe", "skull", "turtle", "walkman",
    "wateringcan",
)  # fmt: skip
KIND = re.compile(
    r"(?P<object>.+?)_(?P<kind>stability_(?:near|far|occluded)|occlusion|interaction_[a-z]+)"
    r"(?:_(?P<side>[hv]))?(?:_(?P<number>\d+))?"
)
CAMERA_KEYS = ("focalX", "focalY", "centerX", "centerY", "width", "height")
# OpenCV's axes from OpenGL's, and back.
FLIP = np.diag([1.0, -1.0, -1.0, 1.0])


def read_laval(path: str | Path) -> list[Sequence]:
    """The sequences below `path`, or the one that `path` is, in order of their names.

    `group` is `occlusion_15` for both `DOG_occlusion_h_15` and `DOG_occlusion_v_15` (the authors'
    figures merge them), `stability_near` …, `interaction_full` …; `object` is the object's name.
    """
    path = Path(path)
    places = [path] if is_laval_sequence(path) else sorted(_folders(path))
    found = [_read(place) for place in places if is_laval_sequence(place)]
    if not found:
        raise InputError(
            f"{path} holds no Laval sequence: looked for folders such as dog_occlusion_0 with "
            "camera.json (focalX …), poses.npy and 0.png."
        )
    return found


def is_laval_sequence(folder: str | Path) -> bool:
    """Whether a folder looks like one sequence of this data set."""
    folder = Path(folder)
    return (folder / "poses.npy").is_file() and (folder / "camera.json").is_file()


def split_name(name: str) -> tuple[str, str]:
    """Object and group of a folder's name: `dog_occlusion_h_15` → (`dog`, `occlusion_15`)."""
    found = KIND.fullmatch(name)
    if found is None:
        raise InputError(
            f"{name} is no name of a Laval sequence; expected OBJECT_occlusion_0, "
            "OBJECT_occlusion_h_15, OBJECT_stability_near_1, OBJECT_interaction_full …."
        )
    kind, number = found["kind"], found["number"]
    return found["object"], f"occlusion_{number}" if kind == "occlusion" else kind


def read_camera(path: str | Path) -> Camera:
    """Camera of a camera.json with focalX, focalY, centerX, centerY, width, height, distortion."""
    path = Path(path)
    content = read_json(path)
    missing = [key for key in CAMERA_KEYS if key not in content]
    if missing:
        raise InputError(f"{path}: {', '.join(missing)} missing; Laval has {CAMERA_KEYS[0]} ….")
    fx, fy, cx, cy = (number(content[key], f"{path}: {key}") for key in CAMERA_KEYS[:4])
    given = content.get("distortion") or []
    rows = given if given and isinstance(given[0], list) else [given]
    lens = tuple(value for row in rows for value in numbers(row, None, f"{path}: distortion"))
    width, height = (whole(content[key], f"{path}: {key}") for key in CAMERA_KEYS[4:])
    return Camera(fx, fy, cx, cy, width, height, lens if any(lens) else None)


def from_opengl(matrices: Any, where: str) -> Pose:
    """Poses (N) of OpenGL view matrices (N, 16) row-major or (N, 4, 4), metres."""
    values = np.asarray(matrices, np.float64)
    if values.ndim not in (2, 3) or not len(values) or values[0].size != 16:
        raise InputError(f"{where}: N × 16 or N × 4 × 4 numbers expected, found {values.shape}.")
    turned = FLIP @ values.reshape(-1, 4, 4)
    if (turned[:, 2, 3] < 0).all():
        raise InputError(
            f"{where}: every object stands behind the camera; Laval's poses are OpenGL's, with the "
            "object at negative z, and these look like OpenCV's."
        )
    return Pose.checked(turned[:, :3, :3], turned[:, :3, 3], where=where)


def to_opengl(poses: Pose) -> NDArray[np.float64]:
    """OpenGL view matrices (N, 4, 4) of poses (N)."""
    return np.asarray(FLIP @ poses.matrix.to(torch.float64).numpy())


def write_laval_sequence(
    root: str | Path,
    name: str,
    mesh: Mesh,
    camera: Camera,
    frames: Iterable[tuple[Image, Pose]],
) -> Path:
    """Write `root/NAME` (for instance dog_occlusion_h_15) and its object's geometry.ply.

    Declared symmetries go beside that. Frames are written as they come. The folder appears when
    all is there, in place of an older one. `InputError` if geometry.ply is there and holds another
    mesh, and for a fisheye lens or a skew, which camera.json cannot hold.
    """
    from PIL import Image as Pillow

    root = Path(root)
    item, _ = split_name(name)
    place = f"{root / name / 'camera.json'}: Laval's format"
    if camera.distortion_model != "opencv":
        raise InputError(
            f"{place} holds OpenCV's coefficients, and the camera has those of a "
            f"{camera.distortion_model} lens; undistort the images (Camera.undistort) and give the "
            "pinhole camera."
        )
    check_no_skew(camera, place)
    write_shared_mesh(root / item / "geometry.ply", mesh, write_ply)
    with replacing_folder(root / name) as folder:
        poses = []
        for number, (image, pose) in enumerate(frames):
            Pillow.fromarray(image).save(folder / f"{number}.png", compress_level=3)
            poses.append(pose)
        matrices = to_opengl(Pose.stack(poses)).reshape(-1, 16)
        with replacing(folder / "poses.npy") as temporary:
            np.save(temporary, matrices)
        values = (camera.fx, camera.fy, camera.cx, camera.cy, camera.width, camera.height)
        lens = list(camera.distortion or (0.0,) * 5)
        named = dict(zip(CAMERA_KEYS, values, strict=True))
        write_json(folder / "camera.json", {**named, "distortion": lens})
        write_json(folder / "meta_data.json", {"metaData": {}})
    return root / name


def _read(folder: Path) -> Sequence:
    name = folder.resolve().name
    item, group = split_name(name)
    matrices = _load(folder / "poses.npy")
    poses = from_opengl(matrices, str(folder / "poses.npy"))
    mesh = folder.resolve().parent / item / "geometry.ply"
    if not mesh.is_file():
        raise InputError(f"{folder}: its object's mesh is missing; looked for {mesh}.")
    numbers = range(len(matrices))
    suffixes = (s for s in (".png", ".jpg") if any((folder / f"{n}{s}").exists() for n in numbers))
    suffix = next(suffixes, "")
    if not suffix:
        raise InputError(f"{folder} holds no 0.png, the first of its {len(matrices)} frames.")
    images = tuple(folder / f"{number}{suffix}" for number in range(len(matrices)))
    truth = {number: poses[number] for number in range(len(matrices))}
    return Sequence(
        name=name,
        folder=folder,
        mesh=mesh,
        frames=folder,
        camera=read_camera(folder / "camera.json"),
        start=truth[0],
        first=0,
        truth=truth,
        images=images,
        group=group,
        object=item,
        symmetric=not symmetries_beside(mesh).is_trivial,
    )


def _load(path: Path) -> NDArray[np.float64]:
    try:
        # Memory-mapped first: a header may promise more than the file holds.
        matrices = np.load(path, allow_pickle=False, mmap_mode="r")
        if not isinstance(matrices, np.ndarray) or matrices.dtype.kind not in "fiu":
            raise ValueError("it holds no array of numbers")
        values = np.asarray(matrices, np.float64)
    except Exception as error:  # numpy's own parser of headers raises what it stumbles upon
        raise InputError(f"{path} is not an array of poses: {str(error)[:120]}.") from error
    if values.ndim == 0 or not len(values):
        raise InputError(f"{path} holds no pose.")
    return values


def _folders(path: Path) -> list[Path]:
    return [place for place in path.iterdir() if place.is_dir()] if path.is_dir() else []
