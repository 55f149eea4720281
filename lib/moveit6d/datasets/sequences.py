"""Sequence folders: frames, camera, mesh, start pose and, for scoring only, the true poses.

Never tracks and never shows the truth to who asks for the start. A folder holds `camera.json`,
`frames/` (or one video file), a mesh (`mesh.glb`, `model.glb`, `model.ply`, metres), `poses.csv`
(the truth, perhaps with holes, perhaps of several objects) and `start.json`; without it the first
row of the truth is the start.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from ..errors import InputError
from ..geometry.camera import Camera
from ..geometry.pose import Pose
from .files import PoseRow, by_frame, read_camera, read_pose, read_poses
from .video import open_frames

MESH_NAMES = tuple(
    f"{stem}.{suffix}" for stem in ("mesh", "model") for suffix in ("glb", "ply", "obj", "stl")
)
VIDEO_NAMES = ("video.mp4", "video.avi", "video.mkv", "video.mov")


@dataclass(frozen=True)
class Sequence:
    """One object followed through one video.

    `frames` is what `open_frames` takes; `start` is the pose in frame `first`; `truth` holds the
    trusted poses by frame number (position in the video, from 0).
    """

    name: str
    folder: Path
    mesh: Path
    frames: Path
    camera: Camera
    start: Pose
    first: int
    truth: Mapping[int, Pose]

    @property
    def level(self) -> str:
        """What sequences are grouped by: `easy` for `easy_00`, the name itself without a number."""
        stem, _, number = self.name.rpartition("_")
        return stem if stem and number.isdecimal() else self.name


def read_sequences(folder: Path) -> list[Sequence]:
    """The sequence in `folder`, or all sequences in the folders in it, in order of their names.

    A folder with several objects gives one sequence an object. Folders that are no sequences are
    passed over; `InputError` if nothing is found.
    """
    if not folder.is_dir():
        raise InputError(f"{folder} is not a folder; it should hold sequences.")
    places = [folder] if _is_sequence(folder) else sorted(p for p in folder.iterdir() if p.is_dir())
    found = [sequence for p in places if _is_sequence(p) for sequence in read_sequence(p)]
    if not found:
        raise InputError(
            f"{folder} holds no sequence: a sequence folder has camera.json, frames/, poses.csv "
            f"and a mesh ({', '.join(MESH_NAMES[:2])} …)."
        )
    return found


def read_sequence(folder: Path) -> list[Sequence]:
    """The sequences of one folder: one an object, most often exactly one."""
    rows = read_poses(folder / "poses.csv")
    frames = _frames(folder)
    names = [path.stem for path in getattr(open_frames(frames), "paths", [])]
    camera = read_camera(folder / "camera.json")
    found = []
    for label in dict.fromkeys(row.object for row in rows):
        where = f"{folder / 'poses.csv'}" + (f", object {label}" if label else "")
        mine = by_frame(_placed((row for row in rows if row.object == label), names, where), where)
        truth = {k: mine[k].pose for k in sorted(mine)}
        known = {frame: pose for frame, pose in truth.items() if pose is not None}
        if not known:
            raise InputError(f"{where} holds no pose.")
        first, start = next(iter(known.items()))
        if not label and (folder / "start.json").exists():
            first, start = 0, read_pose(folder / "start.json")
        found.append(
            Sequence(
                name=f"{folder.resolve().name}.{label}" if label else folder.resolve().name,
                folder=folder,
                mesh=_mesh(folder, label),
                frames=frames,
                camera=camera,
                start=start,
                first=first,
                truth=known,
            )
        )
    return found


def _is_sequence(folder: Path) -> bool:
    if not ((folder / "camera.json").exists() and (folder / "poses.csv").exists()):
        return False
    return any((folder / name).exists() for name in ("frames", *VIDEO_NAMES))


def _placed(rows: Iterable[PoseRow], names: list[str], where: str) -> Iterable[PoseRow]:
    """Rows with their frame number turned into the position of their image in the video."""
    place = {name: index for index, name in enumerate(names)}
    for row in rows:
        stem = Path(row.image).stem
        if row.image and place:
            if stem not in place:
                raise InputError(f"{where}: image {row.image} is not among the frames.")
            yield PoseRow(frame=place[stem], image=row.image, pose=row.pose)
        else:
            yield row


def _frames(folder: Path) -> Path:
    for name in ("frames", *VIDEO_NAMES):
        if (folder / name).exists():
            return folder / name
    raise InputError(f"{folder} holds neither frames/ nor {VIDEO_NAMES[0]}.")


def _mesh(folder: Path, label: str) -> Path:
    suffixes = ("glb", "ply", "obj", "stl")
    names = [f"{label}.{suffix}" for suffix in suffixes] if label else list(MESH_NAMES)
    for name in names:
        if (folder / name).exists():
            return folder / name
    raise InputError(f"{folder} holds no mesh; looked for {', '.join(names)}.")
