"""Keyframes: pictures of a textured object, shown again on its plain mesh, and renderings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation
from torch import Tensor

from moveit6d.config import ActionMode, KeyframeConfig, TrackerConfig
from moveit6d.errors import InputError
from moveit6d.estimation import PoseTracker
from moveit6d.estimation.keyframes import SIZE, Keyframe, KeyframeMemory, recall
from moveit6d.frame import Frame, prepare_frame
from moveit6d.geometry.camera import Camera
from moveit6d.geometry.crop import Crop
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.networks.policy_output import PolicyOutput
from moveit6d.observation import Observation, observe
from moveit6d.policies import LoopState, OraclePolicy
from moveit6d.rendering import make_renderer
from tests.support.meshes import box_arrays, l_shape, sphere, textured_box
from tests.support.pictures import CAMERA, picture

Thing = Callable[[tuple[float, float, float]], tuple[Mesh, Mesh, Pose]]
RENDERER = make_renderer()
REMEMBER = TrackerConfig(keyframes=KeyframeConfig(enabled=True))


def pattern(seed: int = 3) -> np.ndarray:
    """A texture of smooth patches (64, 64, 3)."""
    random = np.random.default_rng(seed)
    rough = random.integers(20, 235, (6, 6, 3)).astype(np.uint8)
    return cv2.resize(rough, (64, 64), interpolation=cv2.INTER_LINEAR)


def box(turn: tuple[float, float, float]) -> tuple[Mesh, Mesh, Pose]:
    """A textured box, the same without colours, and a pose."""
    vertices, faces, _, _ = box_arrays()
    return textured_box(pattern()), Mesh.from_arrays("plain", vertices, faces), at(turn)


def ball(turn: tuple[float, float, float]) -> tuple[Mesh, Mesh, Pose]:
    """A sphere with a colour that changes over it, the same without, and a pose."""
    plain = sphere(subdivisions=4)
    waves = np.sin(60 * plain.vertices + np.array([0, 1, 2])) * 0.5 + 0.5
    colors = (20 + 210 * waves).astype(np.uint8)
    painted = Mesh.from_arrays("ball", plain.vertices, plain.faces, vertex_colors=colors)
    return painted, plain, at(turn)


def at(turn: tuple[float, float, float], z: float = 0.4) -> Pose:
    rotation = Rotation.from_rotvec(turn).as_matrix()
    return Pose(torch.from_numpy(rotation), torch.tensor([0.02, -0.01, z], dtype=torch.float64))


def frame_of(mesh: Mesh, pose: Pose) -> Frame:
    return prepare_frame(picture(mesh, pose).permute(1, 2, 0).numpy(), CAMERA)


def seen(
    frame: Frame, mesh: Mesh, pose: Pose, known: KeyframeMemory | None, zoom: float = 1.0,
    crop: Crop = "look_at",
) -> Observation:  # fmt: skip
    one = Pose(pose.rotation[None], pose.translation[None])
    size = torch.tensor([mesh.sphere_diameter / zoom], dtype=torch.float64)
    observation = observe([frame], [mesh], one, size, RENDERER, crop)
    return recall(observation, [known], [mesh], one, size, crop)


def remembered(mesh: Mesh, *frames: tuple[Frame, Pose]) -> KeyframeMemory:
    known = KeyframeMemory(KeyframeConfig(enabled=True))
    for frame, pose in frames:
        known = known.add(Keyframe.take(frame, mesh, pose, RENDERER))
    return known


def inner(mask: Tensor) -> Tensor:
    """A mask (1, 1, H, W) without its border, where pictures mix the background in."""
    eroded = cv2.erode(mask[0, 0].numpy(), np.ones((9, 9)))
    return torch.from_numpy(eroded)[None, None].bool().expand(1, 3, -1, -1)


@pytest.mark.parametrize("zoom", [1.0, 1.6])
@pytest.mark.parametrize("crop", ["look_at", "axis_parallel"])
@pytest.mark.parametrize("thing", [box, ball])
def test_a_keyframe_at_its_own_pose_is_the_picture(thing: Thing, crop: Crop, zoom: float) -> None:
    painted, plain, pose = thing((0.3, -0.4, 0.2))
    frame = frame_of(painted, pose)
    again = seen(frame, plain, pose, remembered(plain, (frame, pose)), zoom, crop)
    grey = seen(frame, plain, pose, None, zoom, crop)
    inside = inner(again.mask)
    off = (again.rendering - again.image).abs()[inside]
    assert off.median() < 0.01
    # Slanted parts are not remembered, and enlarged there are more of them inside of the patch.
    assert (off < 0.05).float().mean() > 0.7
    assert (grey.rendering - grey.image).abs()[inside].median() > 0.1
    assert float((again.rendering * (1 - again.mask)).max()) == 0
    for name in ("image", "depth", "mask", "distance"):
        assert torch.equal(getattr(again, name), getattr(grey, name))


@pytest.mark.parametrize("thing", [box, ball])
def test_from_another_side_it_shows_what_a_picture_from_there_shows(thing: Thing) -> None:
    painted, plain, then = thing((0.5, -0.6, 0.2))
    now = replace(at((0.3, -0.4, 0.5), 0.45))
    known = remembered(plain, (frame_of(painted, then), then))
    frame = frame_of(painted, now)
    again, grey = seen(frame, plain, now, known), seen(frame, plain, now, None)
    inside = inner(again.mask)
    off = (again.rendering - again.image).abs()[inside]
    assert off.median() < 0.03 < (grey.rendering - grey.image).abs()[inside].median() / 3


def test_what_was_hidden_is_not_remembered() -> None:
    mesh = l_shape()
    colors = np.full_like(mesh.vertices, 200).astype(np.uint8)
    plain = Mesh.from_arrays("plain", mesh.vertices, mesh.faces, vertex_colors=colors)
    then, now = at((0.0, 0.0, 0.0)), at((0.0, 2.6, 0.0))  # from behind
    keyframe = Keyframe.take(frame_of(mesh, then), plain, then, RENDERER)
    again = seen(frame_of(mesh, now), plain, now, None)
    points = torch.zeros(3, 128, 128)
    here = again.mask[0, 0] > 0
    one = Pose(now.rotation[None], now.translation[None])
    size = torch.tensor([mesh.sphere_diameter], dtype=torch.float64)
    buffer = RENDERER.render([plain], one, CAMERA.matrix[None], 256)
    depth = buffer.depth[0, 0].double()
    rows, columns = (depth > 0).nonzero().unbind(1)
    rays = torch.stack([(columns - CAMERA.cx) / CAMERA.fx, (rows - CAMERA.cy) / CAMERA.fy])
    placed = torch.cat([rays, torch.ones(1, len(rows))]) * depth[rows, columns]
    places = now.rotation.mT @ (placed - now.translation[:, None])
    count = min(len(rows), 128 * 128)
    points.view(3, -1)[:, :count] = places[:, :count].float()
    _, weight = keyframe.look_up(points, float(size))
    assert bool(here.any()) and float(weight.view(-1)[:count].mean()) < 0.02


def test_sides_that_no_keyframe_shows_take_on_its_brightness() -> None:
    painted, plain, then = box((0.0, 0.0, 0.0))
    dark = prepare_frame((picture(painted, then) // 3).permute(1, 2, 0).numpy(), CAMERA)
    known = remembered(plain, (dark, then))
    now = at((0.0, 0.7, 0.0))  # half of what is seen is another side
    grey, again = seen(dark, plain, now, None), seen(dark, plain, now, known)
    new = again.rendering / grey.rendering.clamp(min=1e-3)
    assert float(new[again.mask.expand(1, 3, -1, -1) > 0].quantile(0.9)) < 0.6


def test_of_two_keyframes_the_older_one_counts_and_the_newer_one_adds() -> None:
    _, plain, first = box((0.0, 0.0, 0.0))
    second = at((0.0, 1.0, 0.0))
    red, blue = (
        prepare_frame(np.full((256, 256, 3), colour, np.uint8), CAMERA)
        for colour in ((200, 0, 0), (0, 0, 200))
    )
    known = remembered(plain, (red, first), (blue, second))
    found = seen(red, plain, second, known).rendering[0]
    share_red, share_blue = ((found[k] > 0.7).float().mean() for k in (0, 2))
    assert share_red > 0.05 and share_blue > 0.05
    alone = seen(red, plain, second, remembered(plain, (red, first))).rendering[0]
    assert torch.equal(found[0] > 0.7, (alone[0] > 0.7) & (found[0] > 0.7))


def test_frames_are_kept_that_are_confident_and_show_another_side() -> None:
    config = KeyframeConfig(enabled=True, count=2, spread=20.0, min_confidence=0.8)
    known = KeyframeMemory(config)
    frame, plain = prepare_frame(np.zeros((256, 256, 3), np.uint8), CAMERA), box((0, 0, 0))[1]

    def keep(pose: Pose) -> KeyframeMemory:
        return known.add(Keyframe.take(frame, plain, pose, RENDERER))

    assert known.wants(at((0, 0, 0)), 0.8) and not known.wants(at((0, 0, 0)), 0.79)
    known = keep(at((0, 0, 0)))
    assert not known.wants(at((0, np.radians(19), 0)), 1.0)
    assert not known.wants(at((0, 0, 2.0)), 1.0), "turned in the image it shows the same side"
    assert known.wants(at((0, np.radians(21), 0)), 1.0)
    known = keep(at((0, np.radians(50), 0)))
    assert not known.wants(at((0, 2.0, 0)), 1.0), "there are as many as may be"
    assert known.near(at((0, np.radians(-15), 0))) == [known.kept[0]]
    assert known.near(at((0, 3.0, 0))) == []


def test_parts_outside_of_the_image_are_not_remembered() -> None:
    painted, plain, _ = box((0, 0, 0))
    edge = Pose(torch.eye(3).double(), torch.tensor([0.17, 0.0, 0.4]).double())
    keyframe = Keyframe.take(frame_of(painted, edge), plain, edge, RENDERER)
    on = keyframe.depth > 0
    assert keyframe.picture.shape == (3, SIZE, SIZE)
    assert 0.2 < float((keyframe.weight[on] > 0).float().mean()) < 0.8


def test_a_keyframe_sees_through_the_lens() -> None:
    painted, plain, pose = ball((0.3, -0.4, 0.2))
    lens = (-0.25, 0.1, 0.002, -0.001, 0.0)
    camera = Camera.from_matrix(CAMERA.matrix, 256, 256, lens, "opencv")
    image = picture(painted, pose).permute(1, 2, 0).numpy()
    matrix = CAMERA.matrix.numpy()
    grid = np.stack(np.meshgrid(np.arange(256.0), np.arange(256.0)), -1).reshape(-1, 1, 2)
    place = cv2.undistortPoints(grid, matrix, np.array(lens), P=matrix).reshape(256, 256, 2)
    place = place.astype(np.float32)
    bent = cv2.remap(image, place[..., 0], place[..., 1], cv2.INTER_CUBIC)
    straight = Keyframe.take(prepare_frame(image, CAMERA), plain, pose, RENDERER)
    through = Keyframe.take(prepare_frame(bent, camera), plain, pose, RENDERER)
    there = (straight.weight == 1).expand(3, -1, -1)
    assert (through.picture - straight.picture).abs()[there].median() < 0.02


@dataclass
class Watching:
    """Knows the pose, and keeps the renderings that it is shown."""

    pose: Pose
    mode: ActionMode = ActionMode.ALL_AXES
    crop: Crop = "look_at"
    shown: list[Observation] = field(default_factory=list)

    def predict(self, seen: Observation, state: LoopState) -> PolicyOutput:
        """The exact delta."""
        self.shown.append(seen)
        oracle = OraclePolicy(Pose.stack([self.pose] * len(state.target)), self.mode)
        return oracle.predict(seen, replace(state, target=torch.arange(len(state.target))))


@pytest.mark.parametrize("exact", [False, True])
def test_a_tracker_shows_the_policy_what_it_saw(exact: bool) -> None:
    painted, plain, pose = box((0.3, -0.4, 0.2))
    image = picture(painted, pose).permute(1, 2, 0).numpy()
    policy = Watching(pose)
    tracker = PoseTracker(plain, CAMERA, plain.outer(pose), policy=policy, config=REMEMBER)
    if exact:
        tracker.calibrate(image)
    else:
        tracker.update(image)
        first = policy.shown[0]
        assert float((first.rendering - first.image).abs()[inner(first.mask)].median()) > 0.1
    policy.shown.clear()
    tracker.update(image)
    again = policy.shown[0]
    assert float((again.rendering - again.image).abs()[inner(again.mask)].median()) < 0.02
    tracker.reset(plain.outer(pose))
    assert tracker.tracks[0].keyframes == KeyframeMemory(REMEMBER.keyframes)


def test_nothing_is_remembered_unless_asked_for_and_of_no_mesh_with_colours() -> None:
    painted, plain, pose = box((0.3, -0.4, 0.2))
    for mesh, config in ((plain, TrackerConfig()), (painted, REMEMBER)):
        tracker = PoseTracker(mesh, CAMERA, mesh.outer(pose), policy=Watching(pose), config=config)
        tracker.update(picture(painted, pose).permute(1, 2, 0).numpy())
        assert tracker.tracks[0].keyframes is None


def test_settings_that_cannot_be_are_refused() -> None:
    with pytest.raises(InputError, match="count must be 1 or more"):
        KeyframeConfig(count=0)
    with pytest.raises(InputError, match="spread and reach positive"):
        KeyframeConfig(spread=0.0)
    with pytest.raises(InputError, match="hidden and depth_edge must be positive"):
        KeyframeConfig(hidden=0.0)
    with pytest.raises(InputError, match="facing must be two numbers, the smaller first"):
        KeyframeConfig(facing=(0.35, 0.15))
    with pytest.raises(InputError, match="gain must be two positive numbers"):
        KeyframeConfig(gain=(0.0, 5.0))
