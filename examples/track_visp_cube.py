"""Follow a real object: the printed cube of ViSP's test video, 218 grey frames.

    tools/unpack_debian_package.sh visp-images-data demo/visp
    python examples/track_visp_cube.py --visp demo/visp --output demo/real

(`make demo-real` does both.) The package holds the video, the camera, a CAD model without texture
and the pose in the first frame, but no true poses. So the texture comes from the first frame
itself, and the error is against poses found by classical means (`classical_reference.py`), which
are good to about 2 mm.
"""

from __future__ import annotations

import argparse
import sys
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import torch
from classical_reference import follow_box, visible_sides
from numpy.typing import NDArray

from moveit6d import Camera, InputError, Mesh, Pose
from moveit6d.cli.main import main as moveit6d
from moveit6d.datasets.pose_files import (
    POSE_COLUMNS,
    PoseRow,
    read_poses,
    write_camera,
    write_poses,
)
from moveit6d.evaluation.track_scores import EvaluationPoints, score
from moveit6d.geometry.rotation import exp_so3
from moveit6d.synthesis.objects.mesh_file import write_glb

TILE = 128  # pixels of texture a side of the cube
GREY = 150  # sides that the first frame does not show


def main() -> int:
    """Prepare, track, compare."""
    summary, _, details = (__doc__ or "").partition("\n")
    parser = argparse.ArgumentParser(
        description=summary, epilog=details, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--visp", type=Path, required=True, help="the unpacked visp-images-data")
    parser.add_argument("--output", type=Path, required=True, help="folder for the results")
    # Whatever else is given goes to `moveit6d track`: --weights, --threads, --max_iterations …
    args, options = parser.parse_known_args()
    found = sorted(args.visp.rglob("mbt/cube.cao"))
    if not found:
        raise InputError(
            f"{args.visp} does not hold ViSP's test images (no mbt/cube.cao below it)."
        )
    source, output = found[0].parent, args.output
    output.mkdir(parents=True, exist_ok=True)

    frames = sorted((source / "cube").glob("image*.pgm"))
    corners, sides = read_cao(source / "cube.cao")
    first = next(grey(frames))
    camera = read_camera(source / "cube.xml", first.shape[1], first.shape[0])
    start = read_pos(source / "cube.0.pos")

    print("Classical reference poses (points and edges) …")
    reference = list(follow_box(corners, sides, camera, start, grey(frames)))
    rows = [PoseRow(k, frames[k].name, pose) for k, pose in enumerate(reference)]
    write_poses(output / "reference.csv", rows, ("frame", "image", *POSE_COLUMNS))

    mesh = textured_box(corners, sides, camera, reference[0], first)
    write_glb(output / "cube.glb", mesh)
    write_camera(output / "camera.json", camera)
    start.save(output / "start.json")
    command = [
        "track",
        "--mesh",
        str(output / "cube.glb"),
        "--mesh_unit",
        "m",
        "--video",
        str(source / "cube"),
        "--camera",
        str(output / "camera.json"),
        "--start",
        str(output / "start.json"),
        "--output",
        str(output / "track"),
        "--threads",
        "1",
        *options,
    ]
    print("moveit6d", " ".join(command))
    code = moveit6d(command)
    if code:
        return code

    track = {row.frame: row for row in read_poses(output / "track" / "poses.csv")}
    result = score(track, dict(enumerate(reference)), EvaluationPoints.of(mesh))
    print(
        f"ADD against the reference: mean {1000 * result.mean_add:.1f} mm, median "
        f"{1000 * result.median_add:.1f} mm; below 10 % of the diameter "
        f"({100 * mesh.diameter:.1f} cm) in {100 * result.below_10:.1f} % of {result.frames} frames"
    )
    print(f"Look at {output / 'track' / 'overlay.mp4'}")
    return 0


def grey(frames: list[Path]) -> Iterator[NDArray[np.uint8]]:
    """The frames as grey pictures."""
    for path in frames:
        yield np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), np.uint8)


def read_cao(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Corners (8, 3) in metres and sides (6, 4) of ViSP's CAD model of a box."""
    lines = [line.split("#")[0].split() for line in path.read_text().splitlines()]
    words = [line for line in lines if line]
    count = int(words[1][0])
    corners = np.array([[float(n) for n in line] for line in words[2 : 2 + count]])
    sides = [
        [int(n) for n in line[1:]]
        for line in words[2 + count :]
        if line[0] == "4" and len(line) == 5
    ]
    return corners, np.array(sides)


def read_camera(path: Path, width: int, height: int) -> Camera:
    """The camera of ViSP's settings file, which counts pixels from the same place as we do."""
    node = ElementTree.parse(path).getroot().find("camera")
    assert node is not None
    fx, fy, cx, cy = (float(node.findtext(name) or "nan") for name in ("px", "py", "u0", "v0"))
    return Camera(fx, fy, cx, cy, width, height)


def read_pos(path: Path) -> Pose:
    """A pose file of ViSP: translation in metres, then the rotation vector in radians."""
    numbers = torch.tensor([float(n) for n in path.read_text().split()], dtype=torch.float64)
    return Pose.checked(exp_so3(numbers[3:]), numbers[:3], where=str(path))


def textured_box(
    corners: NDArray[np.float64],
    sides: NDArray[np.int64],
    camera: Camera,
    pose: Pose,
    frame: NDArray[np.uint8],
) -> Mesh:
    """The box with each visible side cut out of the frame, the others plain grey."""
    seen = {tuple(side) for side in visible_sides(pose, corners, sides)}
    pixels = camera.project(pose.transform(torch.from_numpy(corners))).numpy()
    square = np.array([[0, 0], [TILE, 0], [TILE, TILE], [0, TILE]], np.float32) - 0.5
    texture = np.full((2 * TILE, 3 * TILE, 3), GREY, np.uint8)
    vertices, faces, uv = [], [], []
    for number, side in enumerate(sides):
        row, column = divmod(number, 3)
        if tuple(side) in seen:
            flat = cv2.getPerspectiveTransform(pixels[side].astype(np.float32), square)
            tile = cv2.warpPerspective(frame, flat, (TILE, TILE), flags=cv2.INTER_LINEAR)
            texture[row * TILE : (row + 1) * TILE, column * TILE : (column + 1) * TILE] = tile[
                ..., None
            ]
        start = 4 * number
        vertices.append(corners[side])
        faces += [[start, start + 1, start + 2], [start, start + 2, start + 3]]
        place = np.array([[0, 1], [1, 1], [1, 0], [0, 0]]) * 0.98 + 0.01
        uv.append((place + (column, 1 - row)) / (3, 2))
    return Mesh.from_arrays(
        "visp_cube",
        np.concatenate(vertices),
        np.array(faces),
        uv=np.concatenate(uv),
        texture=texture,
    )


if __name__ == "__main__":
    try:
        sys.exit(main())
    except InputError as error:
        sys.exit(f"track_visp_cube: {error}")
