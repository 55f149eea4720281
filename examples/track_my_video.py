"""Track your own video in ten lines of Python.

    python examples/track_my_video.py
    python examples/track_my_video.py MESH VIDEO CAMERA_JSON START_JSON

Without arguments a clip is made first. `track_your_video.py` is the same with every failure
handled; `moveit6d track --help` describes the files.
"""

from __future__ import annotations

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from moveit6d import InputError, Mesh, PoseTracker
from moveit6d.datasets.files import read_camera, read_pose
from moveit6d.datasets.video import open_frames


def track(mesh_file: Path, video: Path, camera_file: Path, start_file: Path) -> None:
    """The ten lines."""
    mesh = Mesh.load(mesh_file, unit="m")
    camera = read_camera(camera_file)
    start = read_pose(start_file)
    tracker = PoseTracker(mesh, camera, start)
    for frame in open_frames(video):
        result = tracker.update(frame.image)[0]
        if result.pose is None:
            print(frame.name, result.error)
        else:
            print(frame.name, result.pose.translation.tolist(), f"{result.confidence:.2f}")


def main(files: list[str], frames: int = 30) -> None:
    """Track the files, or a clip made on the spot."""
    if files:
        mesh, video, camera, start = map(Path, files)
        track(mesh, video, camera, start)
        return
    from moveit6d.synthesis.demo_object import demo_object
    from moveit6d.synthesis.sequence import write_sequence

    with TemporaryDirectory() as place:
        clip = Path(place) / "clip"
        write_sequence(clip, mesh=demo_object(), seed=1, frames=frames, level="easy")
        names = ("mesh.glb", "frames", "camera.json", "start.json")
        track(*(clip / name for name in names))


if __name__ == "__main__":
    if len(sys.argv) not in (1, 5) or "--help" in sys.argv:
        sys.exit(__doc__)
    try:
        main(sys.argv[1:])
    except InputError as error:
        sys.exit(f"track_my_video: {error}")
