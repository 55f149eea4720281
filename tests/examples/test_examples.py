"""Every example runs, and the classical reference poses are right on a clip with known truth."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from PIL import Image

from moveit6d.geometry.camera import Camera
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.geometry.rotation import exp_so3, log_so3
from moveit6d.synthesis.levels import Level
from moveit6d.synthesis.primitives import box
from moveit6d.synthesis.sequence import Scene, write_sequence
from moveit6d.synthesis.textures import paint, random_palette

EXAMPLES = Path(__file__).parents[2] / "examples"
SIDE = 0.084
CAMERA = Camera(550.0, 545.0, 319.0, 239.0, 640, 480)


@pytest.fixture
def on_path(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(EXAMPLES))


@dataclass(frozen=True)
class BoxClip:
    """A clip of a printed cube as ViSP's: its files, and the truth that those do not hold."""

    folder: Path
    corners: NDArray[np.float64]
    sides: NDArray[np.int64]
    frames: list[NDArray[np.uint8]]
    truth: list[Pose]


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> BoxClip:
    part = box((SIDE, SIDE, SIDE), detail=1)
    rng = np.random.default_rng(5)
    print_ = np.concatenate(
        [
            np.concatenate([paint(rng, 128, 128, random_palette(rng)) for _ in range(3)], 1)
            for _ in range(2)
        ]
    )
    mesh = Mesh.from_arrays("cube", part.vertices, part.faces, uv=part.uv, texture=print_)
    slow = Level("slow", (1.5, 2.0), (0.8, 1.0), clutter=(0, 0))
    grey_wall = [np.full((60, 80, 3), 120, np.uint8)]
    scene = Scene(mesh, 12, 10, slow, photos=grey_wall, camera=CAMERA)
    shots = [scene.shoot(k) for k in range(10)]
    frames = [np.asarray(Image.fromarray(shot.image).convert("L")) for shot in shots]
    folder = tmp_path_factory.mktemp("visp")
    return BoxClip(
        folder, *_write_visp(folder, frames, shots[0].pose), frames, [s.pose for s in shots]
    )


def _write_visp(
    folder: Path, frames: list[NDArray[np.uint8]], first: Pose
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    half = SIDE / 2
    corners = np.array(
        [[x, y, z] for x in (-half, half) for y in (-half, half) for z in (-half, half)]
    )
    sides = np.array(
        [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    )
    place = folder / "data" / "mbt"
    (place / "cube").mkdir(parents=True)
    lines = ["V1", "# 3D points", "8  # corners", *(" ".join(map(str, row)) for row in corners)]
    lines += ["0", "0", "6 # sides", *("4 " + " ".join(map(str, row)) for row in sides), "0", "0"]
    (place / "cube.cao").write_text("\n".join(lines))
    (place / "cube.xml").write_text(
        f"<conf><camera><u0>{CAMERA.cx}</u0><v0>{CAMERA.cy}</v0><px>{CAMERA.fx}</px>"
        f"<py>{CAMERA.fy}</py></camera></conf>"
    )
    # As in ViSP's package the start is a few millimetres off.
    numbers = [*(first.translation + 0.002).tolist(), *log_so3(first.rotation).tolist()]
    (place / "cube.0.pos").write_text("\n".join(map(str, numbers)))
    for number, frame in enumerate(frames):
        Image.fromarray(frame).save(place / "cube" / f"image{number:04d}.pgm")
    return corners, sides


@pytest.mark.usefixtures("on_path")
def test_classical_reference_finds_the_true_poses(clip: BoxClip) -> None:
    from classical_reference import follow_box

    off = exp_so3(torch.tensor([0.01, -0.01, 0.01], dtype=torch.float64))
    start = Pose(off @ clip.truth[0].rotation, clip.truth[0].translation + 0.002)
    found = list(follow_box(clip.corners, clip.sides, CAMERA, start, clip.frames))
    points = torch.from_numpy(clip.corners)
    for pose, true in zip(found, clip.truth, strict=True):
        error = (pose.transform(points) - true.transform(points)).norm(dim=-1).mean()
        assert float(error) < 0.003


@pytest.mark.usefixtures("on_path")
def test_visible_sides_of_a_cube_seen_head_on(clip: BoxClip) -> None:
    from classical_reference import visible_sides

    ahead = Pose(torch.eye(3, dtype=torch.float64), torch.tensor([0, 0, 0.5], dtype=torch.float64))
    (side,) = visible_sides(ahead, clip.corners, clip.sides)
    assert (clip.corners[side][:, 2] < 0).all()  # the near one


@pytest.mark.usefixtures("on_path")
def test_texture_from_the_first_frame_looks_like_the_frame(clip: BoxClip) -> None:
    from track_visp_cube import textured_box

    from moveit6d.rendering.renderer import make_renderer

    mesh = textured_box(clip.corners, clip.sides, CAMERA, clip.truth[0], clip.frames[0])
    inner = mesh.inner(clip.truth[0])
    batch = Pose(inner.rotation[None], inner.translation[None])
    seen = make_renderer("embree").render([mesh], batch, CAMERA.matrix()[None], 640)
    mask = seen.mask[0, 0, :480].numpy() > 0.5
    picture = 255 * seen.albedo[0, 0, :480].numpy()
    both = np.corrcoef(picture[mask], clip.frames[0][mask])[0, 1]
    assert both > 0.9


@pytest.mark.usefixtures("on_path")
def test_visp_example_runs(
    clip: BoxClip, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    import track_visp_cube

    from moveit6d.policies import OraclePolicy

    # The tracker takes the first true pose for the truth of every frame.
    half = Mesh.from_arrays("cube", clip.corners, np.array([[0, 1, 2], [5, 6, 7]]))
    oracle = OraclePolicy(Pose.stack([half.inner(clip.truth[0])]))
    monkeypatch.setattr("moveit6d.policies.load_policy", lambda *_, **__: oracle)
    command = ["track_visp_cube.py", "--visp", str(clip.folder), "--output", str(tmp_path / "out")]
    monkeypatch.setattr(sys, "argv", [*command, "--no_overlay"])
    assert track_visp_cube.main() == 0
    assert "ADD against the reference: mean" in capsys.readouterr().out
    assert (tmp_path / "out" / "track" / "poses.csv").exists()
    assert (tmp_path / "out" / "reference.csv").exists()


@pytest.mark.usefixtures("on_path")
def test_your_video_example_runs(
    tmp_path: Path, brick: Mesh, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    import track_your_video

    from moveit6d.datasets.files import read_pose
    from moveit6d.policies import OraclePolicy

    folder = write_sequence(tmp_path / "clip", mesh=brick, seed=1, frames=2, level="easy")
    start = read_pose(folder / "start.json")
    oracle = OraclePolicy(Pose.stack([brick.inner(start)]))
    monkeypatch.setattr("moveit6d.estimation.tracker.load_policy", lambda: oracle)
    files = [folder / name for name in ("mesh.glb", "frames", "camera.json", "start.json")]
    track_your_video.main(*map(str, files))
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(":")[0] for line in lines] == ["frame 0", "frame 1"]
    assert "confidence 1.00" in lines[1]


@pytest.mark.parametrize("name", sorted(path.name for path in EXAMPLES.glob("track_*.py")))
def test_examples_say_how_they_are_used(name: str) -> None:
    done = subprocess.run(
        [sys.executable, str(EXAMPLES / name), "--help"], capture_output=True, text=True
    )
    assert f"python examples/{name}" in done.stdout + done.stderr
