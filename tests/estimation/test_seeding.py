"""Seeds: they all look alike, their vectors lead to the object, and its sink is found."""

import numpy as np
import pytest
import torch
from scipy.ndimage import gaussian_filter

from moveit6d.config import ActionMode, SeedDetectorConfig
from moveit6d.errors import InputError
from moveit6d.estimation.seeding import (
    SeedField,
    find_sinks,
    planar_shift,
    seed_field,
    seed_grid,
    seed_poses,
    sink_of,
    smoothed,
    spacing,
)
from moveit6d.frame import prepare_frame
from moveit6d.geometry.camera import Camera
from moveit6d.geometry.crop import look_at
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.geometry.rotation import random_rotations
from moveit6d.networks.policy_output import PolicyOutput
from moveit6d.policies import OraclePolicy
from moveit6d.rendering.backends import make_renderer

CAMERA = Camera(300, 310, 160.5, 118.5, 320, 240)
GRAY = np.full((240, 320, 3), 90, np.uint8)


def a_field(sink: torch.Tensor, step: float = 10.0) -> SeedField:
    """A field with that −∇·V (h, w), seeds every 10 pixels from (0, 0)."""
    height, width = sink.shape
    y, x = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    centres = torch.stack([x, y], -1).double() * step
    zero = torch.zeros(height, width, 2).double()
    return SeedField(centres, zero, sink.double(), zero[..., 0], 4 * step)


def test_seeds_stand_at_their_pixels_and_look_alike() -> None:
    pixels = torch.tensor([[0.0, 0.0], [160.5, 118.5], [310.0, 30.0]], dtype=torch.float64)
    turn = random_rotations(1, torch.Generator().manual_seed(0))[0]
    poses = seed_poses(pixels, turn, 0.2, 60.0, CAMERA)
    torch.testing.assert_close(CAMERA.project(poses.translation), pixels)
    view = look_at(poses, torch.full((3,), 0.2, dtype=torch.float64))
    seen = view.to_virtual(poses)
    torch.testing.assert_close(seen.rotation, turn.expand(3, 3, 3))
    torch.testing.assert_close(view.distance, torch.full((3,), 300 * 0.2 / 60).double())


def test_a_policy_of_axis_parallel_crops_is_refused(brick: Mesh) -> None:
    truth = Pose(torch.eye(3)[None].double(), torch.tensor([[0.0, 0.0, 1.0]]).double())
    policy = OraclePolicy(truth, ActionMode.ALL_AXES, "axis_parallel")
    frame = prepare_frame(GRAY, CAMERA)
    with pytest.raises(InputError, match="look-at"):
        seed_field(frame, brick, torch.eye(3)[None].double(), 60.0, policy, make_renderer())


def test_the_grid_covers_the_image_evenly() -> None:
    centres = seed_grid(CAMERA, 60.0)
    assert spacing(centres) == pytest.approx(24.0)
    torch.testing.assert_close(
        centres.reshape(-1, 2).mean(0), torch.tensor([159.5, 119.5]).double()
    )
    assert centres.min() >= 0 and centres[..., 0].max() <= 319 and centres[..., 1].max() <= 239
    assert centres[0, 0].max() < 24
    few = seed_grid(CAMERA, 1000.0)
    assert min(few.shape[:2]) >= 3
    assert spacing(seed_grid(CAMERA, 60.0, SeedDetectorConfig(spacing=0.5))) == pytest.approx(30.0)
    dense = seed_grid(CAMERA, 1.0, SeedDetectorConfig(max_seeds=16))
    assert dense.shape[1] == 16 and spacing(dense) == pytest.approx(20.0)


def test_smoothing_is_a_gaussian_that_ignores_what_is_outside() -> None:
    field = torch.from_numpy(np.random.default_rng(0).normal(size=(9, 12, 2)))
    weight = gaussian_filter(np.ones((9, 12)), 1.5, mode="constant", truncate=5 / 1.5)
    expected = [
        gaussian_filter(field[..., k].numpy(), 1.5, mode="constant", truncate=5 / 1.5) / weight
        for k in range(2)
    ]
    np.testing.assert_allclose(smoothed(field, 1.5).numpy(), np.stack(expected, -1), atol=1e-12)
    torch.testing.assert_close(smoothed(field, 0.0), field)


def test_a_field_that_flows_inward_has_a_sink() -> None:
    centres = seed_grid(CAMERA, 60.0)
    inward = torch.tensor([100.0, 80.0]).double() - centres
    sink = sink_of(inward, spacing(centres))
    expected = -sum(
        np.gradient(inward[..., k].numpy(), spacing(centres), axis=1 - k) for k in range(2)
    )
    np.testing.assert_allclose(sink.numpy()[1:-1, 1:-1], expected[1:-1, 1:-1])
    assert sink[3, 3].item() == pytest.approx(2.0)
    assert sink[0, 0].item() == pytest.approx(1.0)  # at the edge half of it is not known
    assert (sink_of(-inward, spacing(centres)) < 0).all()


def test_sinks_come_in_the_order_of_their_strength() -> None:
    values = torch.full((8, 10), -0.5)
    values[2, 3], values[2, 4], values[6, 8] = 2.0, 1.0, 3.0
    first, second = find_sinks(a_field(values), 5)
    assert (first.strength, second.strength) == (3.0, 2.0)
    torch.testing.assert_close(first.centre, torch.tensor([80.0, 60.0]).double())
    assert second.centre[0].item() == pytest.approx(100 / 3)  # between its two cells, 2 : 1
    assert find_sinks(a_field(torch.full((5, 5), -1.0)), 3) == []


def test_a_wider_sink_speaks_for_a_larger_object() -> None:
    y, x = torch.meshgrid(torch.arange(15) - 7.0, torch.arange(15) - 7.0, indexing="ij")
    sizes = [
        find_sinks(a_field(torch.exp(-(x**2 + y**2) / (2 * s * s))), 1)[0].size
        for s in (1.3, 2.0, 2.8)
    ]
    assert sizes[0] < sizes[1] < sizes[2]


def test_the_field_of_an_oracle_converges_at_the_object(brick: Mesh) -> None:
    place = torch.tensor([[0.05, -0.03, 0.7]], dtype=torch.float64)
    truth = Pose(torch.eye(3).double()[None], place)
    size = 300 * brick.sphere_diameter / float(place.norm())
    turns = random_rotations(2, torch.Generator().manual_seed(1))
    frame = prepare_frame(GRAY, CAMERA)
    policy = OraclePolicy(truth, ActionMode.ALL_AXES)
    field = seed_field(frame, brick, turns, size, policy, make_renderer())
    centre = CAMERA.project(place)[0]
    towards = torch.nn.functional.normalize(centre - field.centres, dim=-1)
    far = (centre - field.centres).norm(dim=-1) > 5
    assert (field.vectors * towards).sum(-1)[far].min() > 0.99
    sink = find_sinks(field, 1)[0]
    assert (sink.centre - centre).norm() < 0.3 * size
    assert field.confidence.min() == 1 and field.size == size


def test_single_actions_give_the_vector_by_their_odds() -> None:
    logits = torch.full((1, 13), -9.0)
    logits[0, 1], logits[0, 2] = 2.0, 1.0  # left, down
    prediction = PolicyOutput(logits, torch.ones(1, 6), torch.ones(1))
    shift = planar_shift(prediction, ActionMode.SINGLE)[0]
    assert shift[0] < 0 < shift[1] and abs(shift[0] / shift[1]) == pytest.approx(np.e, rel=1e-3)
    assert planar_shift(prediction, ActionMode.ALL_AXES).tolist() == [[1.0, 1.0]]
