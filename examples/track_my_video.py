"""Track your own video in ten lines of Python.

    python examples/track_my_video.py
    python examples/track_my_video.py MESH VIDEO CAMERA_JSON START_JSON

Without arguments a clip is made first; `moveit6d track --help` describes the files, and does the
same with pictures, tables and a report.
"""

from __future__ import annotations

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from moveit6d import Camera, InputError, Mesh, Pose, PoseTracker
from moveit6d.datasets.video import open_frames


def track(mesh_file: Path, video: Path, camera_file: Path, start_file: Path) -> None:
    """Print where the object is in every frame: the ten lines."""
    # The object: OBJ, PLY, GLB or STL. State the unit of its numbers: "m" or "mm".
    mesh = Mesh.load(mesh_file, unit="m")
    # The camera's intrinsics in pixels, and the object's pose in the first frame, roughly.
    camera, start = Camera.load(camera_file), Pose.load(start_file)
    # The shipped network, the embree renderer: both can be replaced by keyword arguments.
    tracker = PoseTracker(mesh, camera, start)
    for frame in open_frames(video):  # a folder, a file or a camera
        if frame.image is None:  # damaged; the track goes on with the next one
            print(f"frame {frame.index}: {frame.error}")
            continue
        result = tracker.update(frame.image)  # one result for each object
        if result.pose is None:
            print(f"frame {frame.index}: {result.error}")
            continue
        x, y, z = result.pose.translation.tolist()
        print(
            f"frame {frame.index}: x {x:+.3f}  y {y:+.3f}  z {z:.3f} m, {result.iterations} "
            "iterations, "
            f"confidence {result.confidence:.2f}, {result.milliseconds:.0f} ms"
        )


def main(files: list[str], frames: int = 30) -> None:
    """Track the files, or a clip made on the spot."""
    if files:
        mesh, video, camera, start = map(Path, files)
        track(mesh, video, camera, start)
        return
    from moveit6d.synthesis.objects.demo_object import demo_object
    from moveit6d.synthesis.sequences.sequence import write_sequence

    with TemporaryDirectory() as place:
        clip = Path(place) / "clip"
        write_sequence(clip, mesh=demo_object(), seed=1, frames=frames, difficulty="easy")
        names = ("mesh.glb", "frames", "camera.json", "start.json")
        track(*(clip / name for name in names))


if __name__ == "__main__":
    if len(sys.argv) not in (1, 5) or "--help" in sys.argv:
        sys.exit(__doc__)
    try:
        main(sys.argv[1:])
    except InputError as error:
        sys.exit(f"track_my_video: {error}")
