"""The closed-form Jacobian and the solve against `PoseAction` itself."""

import math

import torch

from moveit6d.actions import PoseAction
from moveit6d.geometry.camera import project
from moveit6d.geometry.crop import OBJECT_SIZE, PATCH_SIZE, axis_parallel, look_at
from moveit6d.geometry.pose import Pose
from moveit6d.geometry.rotation import random_rotations
from moveit6d.networks.least_squares import (
    cell_pixels,
    jacobian,
    move_points,
    object_pixels,
    precision,
    project_points,
    solve_delta,
    surface_points,
)

DISTANCE = torch.tensor([2.5, 6.0, 12.0], dtype=torch.float64)


def some_points() -> torch.Tensor:
    generator = torch.Generator().manual_seed(0)
    depth = torch.randn(3, 1, 128, 128, dtype=torch.float64, generator=generator) * 0.15
    return surface_points(depth, DISTANCE, cell_pixels(8))


def test_cells_stand_for_their_middle_pixels() -> None:
    assert cell_pixels(8)[:2].tolist() == [[4, 4], [12, 4]]
    assert len(cell_pixels(4)) == (PATCH_SIZE // 4) ** 2


def nearest_by_hand(mask: torch.Tensor, stride: int, x: int, y: int) -> float:
    """Squared distance from a cell's middle pixel to the object's nearest pixel in the cell."""
    block = mask[y : y + stride, x : x + stride].nonzero() - stride // 2
    return float(block.square().sum(1).min()) if len(block) else math.inf


def test_cells_stand_for_the_object_s_nearest_pixel_if_they_have_any() -> None:
    generator = torch.Generator().manual_seed(0)
    mask = (torch.rand(2, 1, PATCH_SIZE, PATCH_SIZE, generator=generator) < 0.05).float()
    mask[1, 0, 40:90, 30:100] = 1
    for stride in (4, 8):
        middles = cell_pixels(stride)
        pixels, covered = object_pixels(mask, stride)
        for picture, found, on in zip(mask[:, 0], pixels, covered, strict=True):
            assert torch.equal(picture[found[:, 1], found[:, 0]], on)
            off = (found - middles).square().sum(1)
            for number, (x, y) in enumerate((middles // stride * stride).tolist()):
                nearest = nearest_by_hand(picture, stride, x, y)
                assert bool(on[number]) == (nearest < math.inf)
                assert off[number] == (nearest if on[number] else 0)


def test_a_line_between_the_middles_of_cells_is_in_them() -> None:
    mask = torch.zeros(1, 1, PATCH_SIZE, PATCH_SIZE)
    mask[0, 0, 64, 10:118] = 1  # the middles are rows 62 and 66
    assert mask[0, 0, cell_pixels(4)[:, 1], cell_pixels(4)[:, 0]].sum() == 0
    assert object_pixels(mask, 4)[1].sum() == 28  # of columns 8 to 119


def test_points_of_a_larger_patch_are_the_same_in_its_middle() -> None:
    generator = torch.Generator().manual_seed(0)
    depth = torch.randn(3, 1, 192, 192, dtype=torch.float64, generator=generator) * 0.15
    middle = depth[..., 32:-32, 32:-32].contiguous()
    found = surface_points(depth, DISTANCE, cell_pixels(8) + 32)
    torch.testing.assert_close(found, surface_points(middle, DISTANCE, cell_pixels(8)))
    mask = (depth > 0.2).float()
    pixels, covered = object_pixels(mask, 8)
    assert torch.equal(mask[0, 0, pixels[0, :, 1], pixels[0, :, 0]], covered[0])
    y, x = torch.meshgrid(torch.arange(24), torch.arange(24), indexing="ij")
    assert (pixels // 8 == torch.stack([x, y], -1).reshape(-1, 2)).all()


def test_points_project_back_to_their_pixels() -> None:
    expected = cell_pixels(8).double().expand(3, -1, -1)
    torch.testing.assert_close(project_points(some_points(), DISTANCE), expected)
    each = torch.stack([cell_pixels(8).roll(shift, 0) for shift in range(3)])
    depth = torch.zeros(3, 1, PATCH_SIZE, PATCH_SIZE, dtype=torch.float64)
    points = surface_points(depth, DISTANCE, each)
    torch.testing.assert_close(project_points(points, DISTANCE), each.double())


def test_moves_are_those_of_pose_action() -> None:
    """The same deltas move points in diameters here and poses in metres there, exactly."""
    delta = torch.randn(3, 6, dtype=torch.float64) * 10
    diameter = torch.tensor([0.1, 0.2, 0.3], dtype=torch.float64)
    place = torch.stack([torch.zeros(3).double(), torch.zeros(3).double(), DISTANCE * diameter], 1)
    start = Pose(random_rotations(3), place)
    moved = PoseAction.from_delta(delta).apply_centred(start, diameter)
    points = some_points() * diameter[:, None, None]
    expected = (moved @ start.inverse()).transform(points)
    found = move_points(some_points(), DISTANCE, delta) * diameter[:, None, None]
    torch.testing.assert_close(found, expected)
    view = look_at(start, diameter)
    torch.testing.assert_close(
        project(found, view.intrinsics), project_points(found / diameter[:, None, None], DISTANCE)
    )


def test_moves_in_axis_parallel_views_are_those_of_pose_action_too() -> None:
    """Away from the axis points count as if their centre stood straight ahead: sheared."""
    delta = torch.randn(3, 6, dtype=torch.float64) * 10
    diameter = torch.tensor([0.1, 0.2, 0.3], dtype=torch.float64)
    direction = torch.tensor([[0.4, -0.3], [0.0, 0.2], [-0.5, 0.1]], dtype=torch.float64)
    place = torch.cat([direction, torch.ones(3, 1).double()], 1) * (DISTANCE * diameter)[:, None]
    start = Pose(random_rotations(3), place)
    moved = PoseAction.from_delta(delta).apply_centred(start, diameter, "axis_parallel")
    shear = torch.eye(3).double().repeat(3, 1, 1)
    shear[:, :2, 2] = -direction
    points = some_points()
    real = (points * diameter[:, None, None]) @ torch.linalg.inv(shear).mT
    expected = (moved @ start.inverse()).transform(real)
    found = move_points(points, DISTANCE, delta, direction)
    torch.testing.assert_close(found * diameter[:, None, None], expected @ shear.mT)
    view = axis_parallel(start, diameter)
    torch.testing.assert_close(project(expected, view.intrinsics), project_points(found, DISTANCE))


def test_jacobian_agrees_with_automatic_differentiation() -> None:
    points = some_points()

    def pixels(delta: torch.Tensor) -> torch.Tensor:
        return project_points(move_points(points, DISTANCE, delta), DISTANCE)

    zero = torch.zeros(3, 6, dtype=torch.float64)
    full = torch.autograd.functional.jacobian(pixels, zero)  # (3, M, 2, 3, 6)
    assert isinstance(full, torch.Tensor)
    expected = torch.stack([full[b, :, :, b] for b in range(3)])
    torch.testing.assert_close(jacobian(points, DISTANCE), expected, atol=1e-9, rtol=1e-9)


def test_solve_recovers_small_moves_and_ignores_cells_without_weight() -> None:
    points = some_points()
    delta = torch.tensor([[0.5, -0.3, 0.2, 0.4, -0.2, 0.3]] * 3, dtype=torch.float64)
    shift = project_points(move_points(points, DISTANCE, delta), DISTANCE)
    shift = shift - project_points(points, DISTANCE)
    weight = torch.ones(3, points.shape[1], dtype=torch.float64)
    shift[:, ::3] += 30  # nonsense where nothing is weighed
    weight[:, ::3] = 0
    damping = torch.full((6,), 1e-9, dtype=torch.float64)
    even = torch.zeros_like(shift)
    found, _ = solve_delta(shift, weight, even, jacobian(points, DISTANCE), damping)
    assert (found - delta).abs().max() < 0.02


def test_without_any_weight_nothing_moves() -> None:
    points = some_points()
    zero = torch.zeros(3, points.shape[1], dtype=torch.float64)
    damping = torch.full((6,), 1e-3, dtype=torch.float64)
    shift = torch.ones(3, points.shape[1], 2, dtype=torch.float64)
    slopes = jacobian(points, DISTANCE)
    found, information = solve_delta(shift, zero, torch.zeros_like(shift), slopes, damping)
    assert found.abs().max() == 0
    assert information.abs().max() == 0  # and nothing is known of it


def test_information_is_the_inverse_covariance_of_deltas_from_noisy_displacements() -> None:
    points = some_points()[:1]
    slopes = jacobian(points, DISTANCE[:1])
    draws, cells = 4000, points.shape[1]
    generator = torch.Generator().manual_seed(0)
    weight = torch.rand(1, cells, generator=generator, dtype=torch.float64) + 0.2
    shape = torch.randn(1, cells, 2, generator=generator, dtype=torch.float64) / 2
    spread = torch.linalg.cholesky(torch.linalg.inv(precision(shape) * weight[..., None, None]))
    noise = torch.randn(draws, cells, 2, 1, generator=generator, dtype=torch.float64)
    shift = (spread @ noise)[..., 0]
    damping = torch.full((6,), 1e-12, dtype=torch.float64)
    every = (one.expand(draws, *one.shape[1:]) for one in (weight, shape, slopes))
    found, information = solve_delta(shift, *every, damping, limit=1e9)
    expected = torch.linalg.inv(information[0])
    scale = expected.diagonal().sqrt()
    scale = scale[:, None] * scale
    torch.testing.assert_close(torch.cov(found.mT) / scale, expected / scale, atol=0.1, rtol=0)


def test_precision_is_the_exponential_of_a_traceless_matrix() -> None:
    shape = torch.tensor([[0.3, -0.2], [0.0, 0.0], [0.0, 0.5], [40.0, 30.0]], dtype=torch.float64)
    found = precision(shape)
    rows = torch.stack([shape, shape.flip(-1) * torch.tensor([1.0, -1.0])], -2)  # [[a, b], [b, −a]]
    length = shape.norm(dim=-1).clamp_min(1e-9)[:, None, None]
    expected = torch.matrix_exp(rows * (2.5 * torch.tanh(length / 2.5) / length))
    torch.testing.assert_close(found, expected, atol=1e-4, rtol=1e-4)
    one = torch.ones(4, dtype=torch.float64)
    torch.testing.assert_close(torch.linalg.det(found), one, atol=1e-4, rtol=0)


def test_noise_along_edges_does_no_harm_where_the_precision_knows_of_it() -> None:
    points = some_points()
    delta = torch.tensor([[0.5, -0.3, 0.4, 0.4, -0.2, 0.3]] * 3, dtype=torch.float64)
    shift = project_points(move_points(points, DISTANCE, delta), DISTANCE)
    shift = shift - project_points(points, DISTANCE)
    generator = torch.Generator().manual_seed(0)
    angle = torch.rand(shift.shape[:2], generator=generator, dtype=torch.float64) * math.pi
    along = torch.stack([angle.cos(), angle.sin()], -1)
    noise = torch.randn(shift.shape[:2], generator=generator, dtype=torch.float64)
    shift = shift + along * noise[..., None] * 3
    # Bad along the edge: log precision −q along it and +q across.
    shape = -2.4 * torch.stack([(2 * angle).cos(), (2 * angle).sin()], -1)
    weight = torch.ones_like(noise)
    damping = torch.full((6,), 1e-9, dtype=torch.float64)
    slopes = jacobian(points, DISTANCE)
    errors = [
        (solve_delta(shift, weight, chosen, slopes, damping)[0] - delta).abs().max()
        for chosen in (shape, torch.zeros_like(shape))
    ]
    assert errors[0] < 0.3 * errors[1]


def test_object_size_is_the_paper_s_margin() -> None:
    assert abs(OBJECT_SIZE - 128 / 1.4) < 1e-12
