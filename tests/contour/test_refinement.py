"""The whole refinement on made pictures: it helps, it holds, and it leaves alone."""

import numpy as np
import pytest
import torch

from moveit6d.actions import PoseAction, pose_delta
from moveit6d.config import ContourConfig
from moveit6d.contour import ColourHistograms, refine_contour
from moveit6d.contour.refinement import jacobian
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.geometry.rotation import exp_so3
from moveit6d.rendering import make_renderer
from tests.support.meshes import colored_box
from tests.support.pictures import CAMERA, mottled, picture

K = CAMERA.matrix


@pytest.fixture(scope="module")
def box() -> Mesh:
    return colored_box()


@pytest.fixture(scope="module")
def truth() -> Pose:
    turn = exp_so3(torch.tensor([0.5, -0.7, 0.3], dtype=torch.float64))
    return Pose(turn, torch.tensor([0.02, -0.01, 0.4], dtype=torch.float64))


def size(mesh: Mesh) -> torch.Tensor:
    return torch.tensor(mesh.sphere_diameter, dtype=torch.float64)


def moved(pose: Pose, mesh: Mesh, *delta: float) -> Pose:
    return PoseAction.from_delta(torch.tensor(delta, dtype=torch.float64)).apply_centred(
        pose, size(mesh)
    )


def off(pose: Pose, truth: Pose, mesh: Mesh) -> torch.Tensor:
    return pose_delta(truth, pose, size(mesh))


def known(mesh: Mesh, truth: Pose) -> ColourHistograms:
    """The colours of a frame before, with the object at its true place."""
    before = refine_contour(picture(mesh, truth, mottled(1)), K, mesh, truth, make_renderer())
    assert before.histograms is not None
    return before.histograms


START = [(2.0, 0, 0, 0, 0, 0), (0, -2.0, 0, 0, 0, 0), (0, 0, 2.0, 0, 0, 0), (0, 0, -2.0, 0, 0, 0)]


# A prior that holds the pose less than the shipped one: the lines then come nearer to the truth.
SHIPPED, WIDE = ContourConfig(), ContourConfig(prior=(0.7, 0.7, 1.5, 1.5, 1.5, 1.0))


@pytest.mark.parametrize("delta", START)
@pytest.mark.parametrize(("config", "left", "share"), [(SHIPPED, 1.0, 0.55), (WIDE, 0.7, 0.5)])
def test_two_counts_of_error_become_less_than_one(
    box: Mesh,
    truth: Pose,
    delta: tuple[float, ...],
    config: ContourConfig,
    left: float,
    share: float,
) -> None:
    image, start = picture(box, truth), moved(truth, box, *delta)
    found = refine_contour(image, K, box, start, make_renderer(), known(box, truth), config)
    assert off(found.pose, truth, box)[:3].abs().max() < left
    assert off(found.pose, truth, box).norm() < share * off(start, truth, box).norm()
    assert found.histograms is not None


@pytest.mark.parametrize(("config", "share"), [(SHIPPED, 0.7), (WIDE, 0.6)])
def test_the_colours_of_the_very_image_do_as_well(
    box: Mesh, truth: Pose, config: ContourConfig, share: float
) -> None:
    start = moved(truth, box, 1.0, -1.0, 1.5, 0, 0, 0)
    found = refine_contour(picture(box, truth), K, box, start, make_renderer(), config=config)
    assert off(found.pose, truth, box).norm() < share * off(start, truth, box).norm()


def test_a_right_pose_stays(box: Mesh, truth: Pose) -> None:
    found = refine_contour(picture(box, truth), K, box, truth, make_renderer(), known(box, truth))
    assert off(found.pose, truth, box).abs().max() < 0.5


def test_something_that_covers_half_does_not_pull_the_object_away(box: Mesh, truth: Pose) -> None:
    image = picture(box, truth)
    image[:, 118:] = torch.from_numpy(mottled(2, (200, 190, 185))).permute(2, 0, 1)[:, 118:]
    found = refine_contour(image, K, box, truth, make_renderer(), known(box, truth))
    assert off(found.pose, truth, box)[:3].abs().max() < 1.0


def test_a_plain_image_moves_nothing(box: Mesh, truth: Pose) -> None:
    gray = torch.full((3, 256, 256), 90, dtype=torch.uint8)
    for histograms in (None, known(box, truth)):
        found = refine_contour(gray, K, box, truth, make_renderer(), histograms)
        assert off(found.pose, truth, box).abs().max() < (1e-6 if histograms is None else 1.5)


def test_an_object_out_of_the_image_stays_where_it_is(box: Mesh, truth: Pose) -> None:
    away = Pose(truth.rotation, truth.translation + torch.tensor([5.0, 0.0, 0.0]))
    found = refine_contour(picture(box, truth), K, box, away, make_renderer())
    assert found.pose is away and found.histograms is None


def test_the_jacobian_is_that_of_the_actions(box: Mesh, truth: Pose) -> None:
    """Finite differences of `PoseAction.apply`, for an object on the camera's axis."""
    pose = Pose(truth.rotation, torch.tensor([0.0, 0.0, 0.4], dtype=torch.float64))
    points = torch.from_numpy(box.vertices.astype(np.float64))
    focal = 128 / 1.4 * 0.4 / box.sphere_diameter  # the patch's

    def pixels(delta: torch.Tensor) -> np.ndarray:
        seen = PoseAction.from_delta(delta).apply_centred(pose, size(box)).transform(points)
        return (seen[:, :2] / seen[:, 2:] * focal).numpy()

    found = jacobian(pose.transform(points).numpy(), pose.translation.numpy(), focal)
    for axis in range(6):
        step = torch.zeros(6, dtype=torch.float64)
        step[axis] = 1e-4
        slope = (pixels(step) - pixels(-step)) / 2e-4
        np.testing.assert_allclose(found[:, :, axis], slope, atol=1e-5)


def test_a_pose_that_is_not_to_move_is_only_judged(box: Mesh, truth: Pose) -> None:
    image, renderer = picture(box, truth, mottled(0)), make_renderer()
    aside = moved(truth, box, 4.0, 0, 0, 0, 0, 0)
    judged = [
        refine_contour(image, K, box, pose, renderer, known(box, truth), moves=False)
        for pose in (truth, aside)
    ]
    assert torch.equal(judged[1].pose.translation, aside.translation)
    assert judged[0].agreement > 0.8 > judged[1].agreement + 0.2
    assert judged[1].histograms is not None


def test_what_lies_beside_the_image_does_not_disagree(box: Mesh, truth: Pose) -> None:
    renderer, histograms = make_renderer(), known(box, truth)
    half = Pose(truth.rotation, truth.translation * torch.tensor([0.0, 1.0, 1.0]))
    half = Pose(half.rotation, half.translation + torch.tensor([0.17, 0.0, 0.0]))
    whole, cut = (
        refine_contour(picture(box, pose), K, box, pose, renderer, histograms, moves=False)
        for pose in (truth, half)
    )
    middle = float(K[0, 0] * half.translation[0] / half.translation[2] + K[0, 2])
    assert abs(middle - 255) < 10, "half of it is beside the image"
    assert cut.agreement > 0.8 * whole.agreement > 0.6
