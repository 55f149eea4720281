"""Every example runs, and the classical reference poses are right on a clip with known truth."""

from __future__ import annotations

import ast
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from PIL import Image

from moveit6d.datasets.mesh_writers import write_obj
from moveit6d.errors import InputError
from moveit6d.geometry.camera import Camera
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.geometry.rotation import exp_so3, log_so3
from moveit6d.geometry.symmetry import Symmetries
from moveit6d.geometry.symmetry_file import write_symmetries
from moveit6d.networks.action_net import ActionNet
from moveit6d.networks.correlation import CorrelationConfig, CorrelationNet
from moveit6d.networks.inference import InferenceNetwork
from moveit6d.networks.weights_file import load_network, save_network
from moveit6d.synthesis.objects.primitives import box
from moveit6d.synthesis.objects.textures import paint, random_palette
from moveit6d.synthesis.sequences.difficulty import Difficulty
from moveit6d.synthesis.sequences.sequence import Scene, write_sequence
from moveit6d.synthesis.training.source import mesh_files
from tests.support.meshes import textured_box
from tests.support.observations import an_observation

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
    slow = Difficulty("slow", (1.5, 2.0), (0.8, 1.0), clutter=(0, 0))
    grey_wall = [np.full((60, 80, 3), 120, np.uint8)]
    scene = Scene(mesh, 12, 10, slow, photos=grey_wall, camera=CAMERA)
    rendered = [scene.render_frame(k) for k in range(10)]
    frames = [np.asarray(Image.fromarray(one.image).convert("L")) for one in rendered]
    folder = tmp_path_factory.mktemp("visp")
    return BoxClip(
        folder, *_write_visp(folder, frames, rendered[0].pose), frames, [s.pose for s in rendered]
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

    from moveit6d.rendering.backends import make_renderer

    mesh = textured_box(clip.corners, clip.sides, CAMERA, clip.truth[0], clip.frames[0])
    inner = mesh.inner(clip.truth[0])
    batch = Pose(inner.rotation[None], inner.translation[None])
    seen = make_renderer("embree").render([mesh], batch, CAMERA.matrix[None], 640)
    mask = seen.mask[0, 0, :480].numpy() > 0.5
    picture = 255 * seen.albedo[0, 0, :480].numpy()
    both = np.corrcoef(picture[mask], clip.frames[0][mask])[0, 1]
    assert both > 0.9


@pytest.mark.usefixtures("on_path")
def test_visp_example_runs(
    clip: BoxClip,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
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
    tmp_path: Path,
    brick: Mesh,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    import track_my_video

    from moveit6d.policies import OraclePolicy

    folder = write_sequence(tmp_path / "clip", mesh=brick, seed=1, frames=2, difficulty="easy")
    start = Pose.load(folder / "start.json")
    oracle = OraclePolicy(Pose.stack([brick.inner(start)]))
    monkeypatch.setattr("moveit6d.estimation.inputs.load_policy", lambda: oracle)
    files = [folder / name for name in ("mesh.glb", "frames", "camera.json", "start.json")]
    track_my_video.main([str(file) for file in files])
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(":")[0] for line in lines] == ["frame 0", "frame 1"]
    assert "confidence 1.00" in lines[1]


@pytest.fixture
def weights(tmp_path: Path) -> Path:
    """A network that knows nothing and is quick."""
    sizes = CorrelationConfig(channels=(4, 6, 8), geometry=(4, 4, 4), context=8, decoder=8, fine=8)
    torch.manual_seed(0)
    save_network(CorrelationNet(sizes), tmp_path / "tiny.safetensors")
    return tmp_path / "tiny.safetensors"


@pytest.mark.usefixtures("on_path")
def test_laval_example_goes_from_the_first_frame_to_a_report(
    weights: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    import laval_unseen_object

    out = tmp_path / "out"
    laval_unseen_object.main(["--output", str(out), "--frames", "3", "--weights", str(weights)])
    assert "robot_occlusion_v_30: ADD below 10 %" in capsys.readouterr().out
    page = (out / "report.html").read_text()
    assert page.count('data-frame="') == 3 and "tiny.safetensors" in page
    assert "surrogate for Laval" in page
    with pytest.raises(InputError, match="robot_occlusion_h_30, robot_occlusion_v_30"):
        laval_unseen_object.main(["--laval", str(out / "data"), "--sequence", "dog_occlusion_0"])


@pytest.mark.usefixtures("on_path")
def test_ten_lines_track_a_made_clip(
    monkeypatch: pytest.MonkeyPatch, weights: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    import track_my_video

    from moveit6d.policies import load_policy

    monkeypatch.setattr("moveit6d.estimation.inputs.load_policy", lambda: load_policy(weights))
    track_my_video.main([], frames=2)
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(":")[0] for line in lines] == ["frame 0", "frame 1"]


@pytest.mark.usefixtures("on_path")
def test_bop_example_writes_refined_estimates(
    weights: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    import refine_bop_estimates

    from moveit6d.datasets.bop import read_results

    options = ["--output", str(tmp_path / "out"), "--images", "2", "--weights", str(weights)]
    refine_bop_estimates.main(options)
    assert "| after " in capsys.readouterr().out
    before, after = (
        read_results(tmp_path / "out" / f"{name}.csv") for name in ("initial", "refined")
    )
    assert [e.image for e in after] == [e.image for e in before] == [0, 1]
    assert not torch.equal(before[0].pose.translation, after[0].pose.translation)
    with pytest.raises(InputError, match="or neither"):
        refine_bop_estimates.main(["--dataset", str(tmp_path)])


@pytest.mark.usefixtures("on_path")
@pytest.mark.filterwarnings("ignore")  # Lightning's own
def test_training_example_trains_on_the_mesh(
    weights: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    import train_on_my_mesh

    from moveit6d.networks.weights_file import load_network

    out = tmp_path / "out"
    train_on_my_mesh.main(
        [
            "--steps",
            "2",
            "--batch",
            "2",
            "--output",
            str(out),
            "--frames",
            "2",
            "--weights",
            str(weights),
        ]
    )
    assert "--weights" in capsys.readouterr().out
    trained, given = (load_network(path) for path in (out / "weights.safetensors", weights))
    assert trained.facts["steps"] == "2"
    assert (out / "config.yaml").is_file(), "there, and not where the command was run"
    one, two = (network.network.state_dict() for network in (trained, given))
    assert any(not torch.equal(one[name], two[name]) for name in one)
    assert (out / "meshes" / "toy_robot.glb").is_file()
    file = tmp_path / "drill.obj"
    write_obj(file, textured_box(np.arange(192, dtype=np.uint8).reshape(8, 8, 3)))
    with pytest.raises(InputError, match=r"made for another mesh \(toy_robot\.glb\)"):
        train_on_my_mesh.main(["--mesh", str(file), "--output", str(out)])


@pytest.mark.usefixtures("on_path")
def test_training_example_takes_along_what_a_mesh_file_needs(tmp_path: Path) -> None:
    import train_on_my_mesh

    picture = np.random.default_rng(0).integers(0, 256, (8, 8, 3), np.uint8)
    (tmp_path / "given").mkdir()
    file = tmp_path / "given" / "drill.obj"  # with drill.mtl and a picture
    write_obj(file, textured_box(picture), "mm")
    axis = {"symmetries_continuous": [{"axis": [0, 0, 1]}]}
    write_symmetries(file, Symmetries.from_bop(axis))
    mesh = Mesh.load(file, "mm")
    folder = train_on_my_mesh.keep_mesh(mesh, tmp_path / "out")
    assert train_on_my_mesh.keep_mesh(mesh, tmp_path / "out") == folder, "gone on with"
    (path,) = mesh_files(folder)
    back = Mesh.load(path)
    assert back.texture is not None and np.array_equal(back.texture, picture)
    assert len(back.symmetries.continuous) == 1
    assert back.diameter == pytest.approx(mesh.diameter, rel=1e-5)
    other = replace(mesh, symmetries=Symmetries())
    with pytest.raises(InputError, match="made for another mesh"):
        train_on_my_mesh.keep_mesh(other, tmp_path / "out")


@pytest.mark.usefixtures("on_path")
def test_own_renderer_agrees_with_embree(
    weights: Path, brick: Mesh, brick_file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    import my_own_renderer

    from moveit6d.rendering.backends import make_renderer

    turn = exp_so3(torch.tensor([0.5, 0.6, 0.1], dtype=torch.float64))
    pose = Pose(turn, torch.tensor([0.0, 0.0, 0.5], dtype=torch.float64))
    one, two = (
        my_own_renderer.patch(renderer, brick, pose)
        for renderer in (make_renderer(), my_own_renderer.PointRenderer())
    )
    assert two.albedo.shape == (1, 3, 128, 128) and two.mask.dtype == torch.float32
    both = (one.mask > 0) & (two.mask > 0)
    either = (one.mask > 0) | (two.mask > 0)
    assert both.sum() / either.sum() > 0.93
    assert (one.depth - two.depth)[both].abs().median() < 0.002
    rgb = both.expand_as(one.albedo)
    assert (one.albedo - two.albedo)[rgb].abs().median() < 0.02
    assert (one.normal * two.normal).sum(1, keepdim=True)[both].median() > 0.99
    my_own_renderer.main(["--mesh", str(brick_file), "--frames", "2", "--weights", str(weights)])
    assert "points: mean error" in capsys.readouterr().out


WEIGHTS = sorted(EXAMPLES.glob("*/*.safetensors"))


@pytest.mark.parametrize("weights", WEIGHTS, ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_weights_of_examples_are_what_their_folder_says(weights: Path) -> None:
    network = load_network(weights).network
    is_papers = weights.parent.name in ("object_specific", "paper_network")
    assert isinstance(network, ActionNet if is_papers else CorrelationNet)
    seen = an_observation(2)
    flat = replace(seen, depth=torch.zeros_like(seen.depth))
    predict = InferenceNetwork(network, compute="float32")
    # Whether the rendering's depth changes what it says.
    assert torch.equal(predict(seen).logits, predict(flat).logits) is (
        weights.parent.name == "no_depth"
    )


NAMES = sorted(path.name for path in EXAMPLES.glob("*.py") if path.stem != "classical_reference")


@pytest.mark.parametrize("name", NAMES)
def test_examples_say_how_they_are_used(name: str) -> None:
    source = (EXAMPLES / name).read_text(encoding="utf-8")
    text = ast.get_docstring(ast.parse(source)) or ""
    assert f"python examples/{name}" in text
    assert "__doc__" in source, "and show it when asked"


@pytest.mark.usefixtures("on_path")
def test_help_shows_what_an_example_says_of_itself(capsys: pytest.CaptureFixture[str]) -> None:
    import my_own_renderer

    with pytest.raises(SystemExit) as ended:
        my_own_renderer.main(["--help"])
    assert ended.value.code == 0 and "python examples/my_own" in capsys.readouterr().out
