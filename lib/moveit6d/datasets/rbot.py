"""The RBOT sequences (Tjaden et al. 2018): 18 objects, four variants of one and the same motion.

Never scores. Layout: `poses_first.txt` (one header line, then R row-major and t in millimetres,
tab separated, the same for all objects and variants), `camera_calibration.txt`, and for each object
`OBJECT/OBJECT.obj` (millimetres) and `OBJECT/frames/a_regular0000.png` ….

Half a pixel: the published principal point counts from the corner of the image, ours from the
centre of the first pixel, so that 0.5 is taken off (as in DLR-RM/3DObjectTracking
M3T/examples/rbot_evaluator.h, which for other data sets takes nothing off).
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..geometry.camera import Camera
from ..geometry.mesh import Mesh
from ..geometry.pose import Pose
from ..geometry.symmetry_file import symmetries_beside, write_symmetries
from ..io import read_text, replacing
from .mesh_writers import write_obj
from .sequences import Sequence
from .video import Image, image_size

VARIANTS = ("a_regular", "b_dynamiclight", "c_noisy", "d_occlusion")
POSES, CALIBRATION = "poses_first.txt", "camera_calibration.txt"
HALF = 0.5  # pixel, see above
HEAD = "r11\tr12\tr13\tr21\tr22\tr23\tr31\tr32\tr33\tt1\tt2\tt3"


def read_rbot(path: Path) -> list[Sequence]:
    """One sequence an object and variant, named `cat.a_regular`, grouped by variant."""
    if not is_rbot(path):
        raise InputError(
            f"{path} holds no RBOT data: looked for {POSES} beside folders of objects with frames/."
        )
    poses = _read_poses(path / POSES)
    found = [
        sequence
        for folder in sorted(p for p in path.iterdir() if (p / "frames").is_dir())
        for variant in VARIANTS
        for sequence in _read(path, folder, variant, poses)
    ]
    if not found:
        raise InputError(f"{path} holds no frames; looked for OBJECT/frames/{VARIANTS[0]}0000.png.")
    return found


def is_rbot(path: Path) -> bool:
    """Whether RBOT's layout lies at `path`."""
    return (path / POSES).is_file()


def write_rbot(
    path: Path,
    name: str,
    mesh: Mesh,
    camera: Camera,
    frames: Iterable[tuple[Image, Pose]],
    variant: str = VARIANTS[0],
) -> Path:
    """Write one object's frames of one variant and the files that all share; returns its folder."""
    from PIL import Image as Pillow

    folder = path / name
    (folder / "frames").mkdir(parents=True, exist_ok=True)
    write_obj(folder / f"{name}.obj", mesh, "mm")
    write_symmetries(folder / f"{name}.obj", mesh.symmetries)
    rows = []
    for number, (image, pose) in enumerate(frames):
        Pillow.fromarray(image).save(folder / "frames" / f"{variant}{number:04d}.png")
        numbers = [*pose.rotation.reshape(9).tolist(), *(1000 * pose.translation).tolist()]
        rows.append("\t".join(f"{value:.9g}" for value in numbers))
    with replacing(path / POSES) as temporary:
        temporary.write_text("\n".join([HEAD, *rows]) + "\n", encoding="utf-8")
    values = (camera.fx, camera.fy, camera.cx + HALF, camera.cy + HALF)
    with replacing(path / CALIBRATION) as temporary:
        line = "\t".join(f"{value:.9g}" for value in values)
        temporary.write_text(f"fx\tfy\tcx\tcy\n{line}\n", encoding="utf-8")
    return folder


def _read(path: Path, folder: Path, variant: str, poses: Pose) -> list[Sequence]:
    images = sorted((folder / "frames").glob(f"{variant}[0-9]*.png"))[: len(poses)]
    if not images:
        return []
    mesh = folder / f"{folder.name}.obj"
    if not mesh.is_file():
        raise InputError(f"{folder}: its mesh is missing; looked for {mesh.name}.")
    width, height = image_size(images[0])
    fx, fy, cx, cy = _read_numbers(path / CALIBRATION, 4)[0, :4].tolist()
    truth = {number: poses[number] for number in range(len(images))}
    return [
        Sequence(
            name=f"{folder.name}.{variant}",
            folder=folder,
            mesh=mesh,
            frames=folder / "frames",
            camera=Camera(fx, fy, cx - HALF, cy - HALF, width, height),
            start=truth[0],
            first=0,
            truth=truth,
            mesh_unit="mm",
            images=tuple(images),
            group=variant,
            object=folder.name,
            symmetric=not symmetries_beside(mesh).is_trivial,
        )
    ]


def _read_poses(path: Path) -> Pose:
    numbers = _read_numbers(path, 12)
    return Pose.checked(numbers[:, :9], numbers[:, 9:12] / 1000, where=str(path))


def _read_numbers(path: Path, columns: int) -> NDArray[np.float64]:
    """The numbers (rows, columns) below the header line."""
    lines = [line.split() for line in read_text(path).splitlines()[1:] if line.strip()]
    try:
        numbers = np.array([[float(value) for value in line] for line in lines], np.float64)
    except ValueError as error:
        reason = str(error)[:80]
        raise InputError(f"{path} cannot be read below its header line: {reason}.") from error
    if numbers.ndim != 2 or numbers.shape[1] < columns or not np.isfinite(numbers).all():
        raise InputError(
            f"{path}: {columns} finite numbers a line expected, found {numbers.shape}."
        )
    return np.asarray(numbers, np.float64)
