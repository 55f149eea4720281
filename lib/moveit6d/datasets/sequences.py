"""Sequences of any format, and sequence folders: frames, camera, mesh, start and the true poses.

Never tracks and never shows the truth to who asks for the start. A folder holds `camera.json`,
`frames/` (or one video file), a mesh (`mesh.glb`, `model.glb`, `model.ply`, metres), `poses.csv`
(the truth, perhaps with holes, perhaps of several objects) and `start.json`; without it the first
row of the truth is the start.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from ..checks import file_name
from ..errors import InputError
from ..geometry.camera import Camera
from ..geometry.mesh import Mesh, Unit
from ..geometry.pose import Pose
from ..geometry.symmetry import Symmetries
from ..geometry.symmetry_file import symmetries_beside
from .pose_files import PoseRow, by_frame, read_camera, read_poses
from .video import FrameSource, ImageList, Prefetched, image_files, open_frames

MESH_NAMES = tuple(
    f"{stem}.{suffix}" for stem in ("mesh", "model") for suffix in ("glb", "ply", "obj", "stl")
)
OWN_FILES = ("camera.json", "poses.csv", "start.json")
VIDEO_NAMES = ("video.mp4", "video.avi", "video.mkv", "video.mov")
VIDEO_FRAME = re.compile(r"#\d{6,}$")  # how `open_frames` calls the frames of a video


@dataclass(frozen=True)
class Sequence:
    """One object followed through one video, whatever format it was read from.

    `start` is the pose in frame `first`; `truth` holds the trusted poses by frame number (position
    in the video, from 0). Poses belong to the mesh file's frame, in metres, OpenCV axes.
    """

    name: str
    folder: Path
    mesh: Path
    frames: Path  # what `open_frames` takes, unless `images` lists them
    camera: Camera
    start: Pose
    first: int
    truth: Mapping[int, Pose]
    mesh_unit: Unit = "m"
    images: tuple[Path, ...] | None = None  # the image files in order, instead of `frames`
    points: Path | None = None  # evaluation points that come with the object, metres
    group: str = ""  # what tables group by, where the name does not tell
    object: str = ""  # name of the object
    symmetric: bool = False  # ADD-S is its metric
    symmetries: Symmetries | None = None  # as declared by the data set
    keyframes: frozenset[int] | None = None  # the frames that are scored, where not all are

    def __post_init__(self) -> None:
        file_name(self.name, str(self.folder))  # results are called by it

    @property
    def level(self) -> str:
        """What sequences are grouped by: `group`, else `easy` for `easy_00`, else the name."""
        if self.group:
            return self.group
        stem, _, number = self.name.rpartition("_")
        return stem if stem and number.isdecimal() else self.name

    @property
    def image_paths(self) -> tuple[Path, ...]:
        """The image files in order; empty where the frames are a video."""
        return self.images if self.images is not None else image_files(open_frames(self.frames))

    @property
    def image_names(self) -> list[str]:
        """The image files' names in order, without suffix; empty where the frames are a video."""
        return [path.stem for path in self.image_paths]

    @property
    def files(self) -> tuple[Path, ...]:
        """The files that it is read from: frames, mesh, points, and its own ones in `folder`."""
        own = (self.folder / name for name in OWN_FILES)
        points = () if self.points is None else (self.points,)
        return (*own, self.mesh, *points, *(self.image_paths or (self.frames,)))

    def load_mesh(self) -> Mesh:
        """The object's mesh, read anew at each call."""
        return Mesh.load(self.mesh, self.mesh_unit, self.symmetries, allow_flat=True)

    def open(self) -> FrameSource:
        """The frames in order, a few of them read ahead: memory does not grow with the length."""
        listed = None if self.images is None else ImageList(self.images)
        return Prefetched(open_frames(self.frames) if listed is None else listed)


def read_sequences(folder: str | Path) -> list[Sequence]:
    """The sequence in `folder`, or all sequences in the folders in it, in order of their names.

    A folder with several objects gives one sequence an object. Folders that are no sequences are
    passed over; `InputError` if nothing is found.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError(f"{folder} is not a folder; it should hold sequences.")
    places = [folder] if is_sequence(folder) else sorted(p for p in folder.iterdir() if p.is_dir())
    found = [sequence for p in places if is_sequence(p) for sequence in read_sequence(p)]
    if not found:
        raise InputError(
            f"{folder} holds no sequence: a sequence folder has camera.json, frames/, poses.csv "
            f"and a mesh ({', '.join(MESH_NAMES[:2])} …)."
        )
    return found


def read_sequence(folder: str | Path) -> list[Sequence]:
    """The sequences of one folder: one an object, most often exactly one."""
    folder = Path(folder)
    rows = read_poses(
        folder / "poses.csv",
        center=lambda label: Mesh.load(_mesh(folder, label), allow_flat=True).center,
    )
    frames = _frames(folder)
    names = [path.stem for path in image_files(open_frames(frames))]
    camera = read_camera(folder / "camera.json")
    found = []
    for label in dict.fromkeys(row.object for row in rows):
        if label:
            file_name(label, str(folder / "poses.csv"))
        where = f"{folder / 'poses.csv'}" + (f", object {label}" if label else "")
        mine = by_frame(placed((row for row in rows if row.object == label), names, where), where)
        truth = {k: mine[k].pose for k in sorted(mine)}
        known = {frame: pose for frame, pose in truth.items() if pose is not None}
        if not known:
            raise InputError(f"{where} holds no pose.")
        first, start = next(iter(known.items()))
        if not label and (folder / "start.json").exists():
            first, start = 0, Pose.load(folder / "start.json")
        mesh = _mesh(folder, label)
        found.append(
            Sequence(
                name=f"{folder.resolve().name}.{label}" if label else folder.resolve().name,
                folder=folder,
                mesh=mesh,
                frames=frames,
                camera=camera,
                start=start,
                first=first,
                truth=known,
                object=label,
                symmetric=not symmetries_beside(mesh).is_trivial,
            )
        )
    return found


def is_sequence(folder: str | Path) -> bool:
    """Whether a folder looks like a sequence folder."""
    folder = Path(folder)
    if not ((folder / "camera.json").exists() and (folder / "poses.csv").exists()):
        return False
    return any((folder / name).exists() for name in ("frames", *VIDEO_NAMES))


def placed(rows: Iterable[PoseRow], names: Iterable[str], where: str) -> Iterable[PoseRow]:
    """Rows with their frame number turned into the position of their image among `names`.

    These are image files' names without suffix. A row without an image, or with a video's frame
    (`clip.mp4#000012`), keeps its number. `InputError` for an image that is not among them.
    """
    place = {name: index for index, name in enumerate(names)}
    for row in rows:
        stem = Path(row.image).stem
        if stem in place:
            row = replace(row, frame=place[stem])
        elif row.image and place and not VIDEO_FRAME.search(row.image):
            first, *_, last = (*place, *place)
            raise InputError(
                f"{where}: image {row.image} is not among the frames, {first} to {last}; the rows "
                "must be of the same video."
            )
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
