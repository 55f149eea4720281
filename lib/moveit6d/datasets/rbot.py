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
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..geometry.camera import Camera
from ..geometry.mesh import Mesh
from ..geometry.pose import Pose
from ..geometry.symmetry_file import symmetries_beside
from ..io import read_text, replacing
from .mesh_writers import write_obj
from .sequences import Sequence
from .video import Image, first_size
from .writer_checks import check_no_lens, check_no_skew, write_shared_mesh

VARIANTS = ("a_regular", "b_dynamiclight", "c_noisy", "d_occlusion")
POSES, CALIBRATION = "poses_first.txt", "camera_calibration.txt"
HALF = 0.5  # pixel, see above
SAME = 1e-5  # what published and written digits leave of a pose, metres
HEAD = "r11\tr12\tr13\tr21\tr22\tr23\tr31\tr32\tr33\tt1\tt2\tt3"


def read_rbot(path: str | Path) -> list[Sequence]:
    """One sequence an object and variant, named `cat.a_regular`, grouped by variant."""
    path = Path(path)
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


def is_rbot(path: str | Path) -> bool:
    """Whether RBOT's layout lies at `path`."""
    return (Path(path) / POSES).is_file()


def write_rbot(
    path: str | Path,
    name: str,
    mesh: Mesh,
    camera: Camera,
    frames: Iterable[tuple[Image, Pose]],
    variant: str = VARIANTS[0],
) -> Path:
    """Write one object's frames of one variant and the files that all share; returns its folder.

    Frames are written as they come; they appear when all are there, in place of older ones of the
    variant. `InputError` for a camera with a lens or a skew, which the format cannot hold, and if
    the poses, the camera or the mesh are others than those of the sequences that are there.
    """
    from PIL import Image as Pillow

    path = Path(path)
    folder = path / name
    check_no_lens(camera, f"{path / CALIBRATION}: RBOT's format")
    check_no_skew(camera, f"{path / CALIBRATION}: RBOT's format")
    others = _others(path, folder / "frames", variant)
    values = (camera.fx, camera.fy, camera.cx + HALF, camera.cy + HALF)
    if others:
        _check_same_camera(path / CALIBRATION, values, others[0])
    shared = _read_poses(path / POSES) if others else None
    write_shared_mesh(folder / f"{name}.obj", mesh, write_obj, "mm")
    rows: list[str] = []
    with TemporaryDirectory(prefix=".frames.", dir=folder) as work:
        for number, (image, pose) in enumerate(frames):
            if shared is not None and number < len(shared):
                _check_same_pose(pose, shared[number], path / POSES, number)
            Pillow.fromarray(image).save(Path(work) / f"{variant}{number:04d}.png")
            numbers = [*pose.rotation.reshape(9).tolist(), *(1000 * pose.translation).tolist()]
            rows.append("\t".join(f"{value:.9g}" for value in numbers))
        (folder / "frames").mkdir(exist_ok=True)
        for older in _numbered(folder / "frames", variant).values():
            older.unlink()
        for image_file in Path(work).iterdir():
            image_file.replace(folder / "frames" / image_file.name)
    if shared is None or len(rows) > len(shared):
        with replacing(path / POSES) as temporary:
            temporary.write_text("\n".join([HEAD, *rows]) + "\n", encoding="utf-8")
    if not others:
        with replacing(path / CALIBRATION) as temporary:
            line = "\t".join(f"{value:.9g}" for value in values)
            temporary.write_text(f"fx\tfy\tcx\tcy\n{line}\n", encoding="utf-8")
    return folder


def _others(path: Path, frames: Path, variant: str) -> list[Path]:
    """Folders of frames in which there are sequences other than this variant of this object."""
    return [
        place
        for place in sorted(path.glob("*/frames"))
        for other in VARIANTS
        if (place, other) != (frames, variant) and _numbered(place, other)
    ]


def _check_same_camera(path: Path, values: tuple[float, ...], other: Path) -> None:
    there = _read_numbers(path, 4)[0, :4]
    if not np.allclose(there, values, rtol=1e-6, atol=0):
        raise InputError(
            f"{path} is there and holds another camera, that of {other} too; write this sequence "
            "into another folder."
        )


def _check_same_pose(pose: Pose, shared: Pose, path: Path, number: int) -> None:
    turned = (pose.rotation - shared.rotation).abs().max()
    moved = (pose.translation - shared.translation).abs().max()
    if turned > SAME or moved > SAME:
        raise InputError(
            f"{path} is there and holds another pose of frame {number}; all objects and variants "
            "share one motion, so write this sequence into another folder."
        )


def _numbered(frames: Path, variant: str) -> dict[int, Path]:
    """The images of a variant by the number in their names."""
    found = {}
    for image in frames.glob(f"{variant}[0-9]*.png"):
        digits = image.stem.removeprefix(variant)
        if digits.isdecimal():
            found[int(digits)] = image
    return found


def _read(path: Path, folder: Path, variant: str, poses: Pose) -> list[Sequence]:
    there = _numbered(folder / "frames", variant)
    if not there:
        return []
    # By number, not by place: a gap is a frame with an error, and the truth behind it stays right.
    images = tuple(
        there.get(number, folder / "frames" / f"{variant}{number:04d}.png")
        for number in range(min(max(there) + 1, len(poses)))
    )
    mesh = folder / f"{folder.name}.obj"
    if not mesh.is_file():
        raise InputError(f"{folder}: its mesh is missing; looked for {mesh.name}.")
    width, height = first_size(images)
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
            images=images,
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
