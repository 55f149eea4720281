"""What several test folders need: a small object, small sequences, and the shared data if there."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from moveit6d.datasets.pose_files import (
    POSE_COLUMNS,
    PoseRow,
    write_camera,
    write_poses,
)
from moveit6d.geometry.camera import Camera
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.geometry.rotation import exp_so3

CAMERA = Camera(180.0, 182.0, 78.0, 61.0, 160, 120)


@pytest.fixture(autouse=True, scope="session")
def one_thread() -> None:
    """Tests run beside each other; each keeps to one core."""
    torch.set_num_threads(1)


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder of data beside the repository; tests that need it are skipped without it."""
    folder = Path(__file__).resolve().parents[2] / "shared"
    if not (folder / "bench").is_dir():
        pytest.skip("needs ../shared")
    return folder


@pytest.fixture(scope="session")
def brick_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A brick of 12 × 8 × 5 cm, off its file's origin, each corner of another colour; metres."""
    import trimesh

    brick = trimesh.creation.box((0.12, 0.08, 0.05)).subdivide().subdivide()
    brick.apply_translation((0.03, -0.01, 0.02))
    low, high = brick.bounds
    colors = 55 + 200 * (brick.vertices - low) / (high - low)
    brick.visual.vertex_colors = colors.astype(np.uint8)
    path = tmp_path_factory.mktemp("brick") / "brick.ply"
    brick.export(path)
    return path


@pytest.fixture(scope="session")
def brick(brick_file: Path) -> Mesh:
    """The brick, loaded."""
    return Mesh.load(brick_file, "m")


@dataclass(frozen=True)
class BrickScene:
    """The brick moving slowly in front of grey, seen by a camera of 160 × 120."""

    mesh: Mesh
    camera: Camera = CAMERA

    def pose(self, frame: int) -> Pose:
        """The true pose in a frame."""
        turn = [0.5 + 0.02 * frame, 0.6, 0.1 * math.sin(frame / 3)]
        place = [-0.03 + 0.002 * frame, 0.01, 0.5]
        return Pose(
            exp_so3(torch.tensor(turn, dtype=torch.float64)),
            torch.tensor(place, dtype=torch.float64),
        )

    def image(self, frame: int) -> NDArray[np.uint8]:
        """What the camera sees: (120, 160, 3)."""
        from moveit6d.rendering.backends import make_renderer
        from moveit6d.rendering.shading import shade_plain

        camera, inner = self.camera, self.mesh.inner(self.pose(frame))
        batch = Pose(inner.rotation[None], inner.translation[None])
        size = max(camera.width, camera.height)
        seen = make_renderer().render([self.mesh], batch, camera.matrix[None], size)
        picture = shade_plain(seen) * seen.mask + 0.4 * (1 - seen.mask)
        whole = (255 * picture[0]).round().clamp(0, 255).byte().permute(1, 2, 0).numpy()
        return np.ascontiguousarray(whole[: camera.height, : camera.width])


@pytest.fixture(scope="session")
def scene(brick: Mesh) -> BrickScene:
    """The moving brick."""
    return BrickScene(brick)


@dataclass(frozen=True)
class SmallSequence:
    """A rendered sequence folder and what it was made from."""

    folder: Path
    camera: Camera
    poses: list[Pose]


@pytest.fixture
def make_sequence(
    tmp_path: Path, scene: BrickScene, brick_file: Path
) -> Callable[..., SmallSequence]:
    """Makes sequence folders of the moving brick."""

    def make(
        name: str = "easy_00", frames: int = 6, start: bool = True, still: bool = False
    ) -> SmallSequence:
        from PIL import Image

        folder = tmp_path / "sequences" / name
        (folder / "frames").mkdir(parents=True)
        (folder / "mesh.ply").write_bytes(brick_file.read_bytes())
        write_camera(folder / "camera.json", scene.camera)
        times = [0 if still else frame for frame in range(frames)]
        poses = [scene.pose(time) for time in times]
        rows = []
        for frame, time in enumerate(times):
            image = f"{frame:06d}.png"
            Image.fromarray(scene.image(time)).save(folder / "frames" / image)
            rows.append(PoseRow(frame, f"frames/{image}", poses[frame]))
        write_poses(folder / "poses.csv", rows, ("frame", "image", *POSE_COLUMNS))
        if start:
            poses[0].save(folder / "start.json")
        return SmallSequence(folder, scene.camera, poses)

    return make
