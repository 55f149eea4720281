"""Single pictures: the object is where the truth says, and occluders occlude."""

import numpy as np
import pytest
import torch

from moveit6d.errors import InputError
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.rendering.backends import make_renderer
from moveit6d.synthesis.default_camera import CAMERA
from moveit6d.synthesis.single_images import make_cases

GREY = [np.full((120, 160, 3), 128, np.uint8)]


def some_cases(brick: Mesh, occluded: float = 0.0, gamma: float = 2.2) -> list:  # type: ignore[type-arg]
    cases = make_cases(
        [brick], GREY, make_renderer(), cluster="all_small", occluded=occluded, number=4, seed=1,
        gamma=gamma,
    )  # fmt: skip
    return list(cases)


def test_the_object_is_drawn_at_the_true_pose(brick: Mesh) -> None:
    """Where the picture is not the grey photo, and only there, the renderer sees the object."""
    for case in some_cases(brick):
        image = case.target.image.float()
        chroma = image.amax(-1) - image.amin(-1)
        pose = brick.inner(case.truth)
        batch = Pose(pose.rotation[None], pose.translation[None])
        buffer = make_renderer().render([brick], batch, CAMERA.matrix[None], 640)
        mask = buffer.mask[0, 0, :480] > 0
        assert chroma[mask].median() > 30 > chroma[~mask].median()


def test_an_occluder_changes_the_picture(brick: Mesh) -> None:
    plain, occluded = some_cases(brick)[0], some_cases(brick, 1.0)[0]
    assert not torch.equal(plain.target.image, occluded.target.image)


def test_light_mixes_at_the_edge_or_colours_do(brick: Mesh) -> None:
    """On an edge the root of a mean is brighter than the mean of roots."""
    light, colours = (
        some_cases(brick, gamma=gamma)[0].target.image.float() for gamma in (2.2, 1.0)
    )
    brighter = light - colours
    assert brighter.min() >= -1  # one grey level of rounding
    assert brighter.max() > 5
    assert (brighter > 1).float().mean() < 0.02


def test_a_gamma_that_no_camera_has_is_refused(brick: Mesh) -> None:
    with pytest.raises(InputError, match=r"gamma is 0\.0, must be above 0"):
        some_cases(brick, gamma=0.0)
