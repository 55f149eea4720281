"""Follow your own object, step by step in Python.

    python examples/track_your_video.py mesh.glb video.mp4 camera.json start.json

Shorter on the command line: `moveit6d track --help`.
"""

from __future__ import annotations

import sys
from pathlib import Path

from moveit6d import InputError, Mesh, PoseTracker
from moveit6d.datasets.files import read_camera, read_pose
from moveit6d.datasets.video import open_frames


def main(mesh_file: str, video: str, camera_file: str, start_file: str) -> None:
    """Print where the object is in every frame."""
    # The object: OBJ, PLY, GLB or STL. State the unit of its numbers: "m" or "mm".
    mesh = Mesh.load(mesh_file, unit="m")

    # The camera's intrinsics in pixels, and the object's pose in the first frame, roughly.
    camera = read_camera(Path(camera_file))
    start = read_pose(Path(start_file))

    # The shipped network, the embree renderer: both can be replaced by keyword arguments.
    tracker = PoseTracker(mesh, camera, start)

    for frame in open_frames(video):
        if frame.image is None:
            print(f"frame {frame.index}: {frame.error}")
            continue
        result = tracker.update(frame.image)[0]  # one result for each object
        if result.pose is None:
            print(f"frame {frame.index}: {result.error}")
            continue
        x, y, z = result.pose.translation.tolist()
        print(
            f"frame {frame.index}: x {x:+.3f}  y {y:+.3f}  z {z:.3f} m, {result.steps} steps, "
            f"confidence {result.confidence:.2f}, {result.milliseconds:.0f} ms"
        )


if __name__ == "__main__":
    if len(sys.argv) != 5:
        sys.exit(__doc__)
    try:
        main(*sys.argv[1:])
    except InputError as error:
        sys.exit(f"track_your_video: {error}")
