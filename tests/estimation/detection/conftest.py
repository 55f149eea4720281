"""A small search: few rotations, the shipped network, the brick before a mottled background."""

from __future__ import annotations

from dataclasses import dataclass

import pytest
import torch
from numpy.typing import NDArray

from moveit6d import load_policy, make_renderer
from moveit6d.config import DetectorConfig, MatchConfig, TemplateConfig, TrackerConfig
from moveit6d.estimation.detection import PoseDetector, TemplateStore
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.geometry.rotation import exp_so3
from moveit6d.policies import NetworkPolicy
from tests.support import meshes, pictures

SMALL = TrackerConfig(
    detection=DetectorConfig(
        templates=TemplateConfig(rotations=240, coarse_rotations=60, width=88),
        match=MatchConfig(widths=(0.3, 0.6), places=8, views=8),
        stages=((16, 2), (3, 6)),
    )
)


@dataclass(frozen=True)
class Picture:
    """An image (256, 256, 3) of the coloured box and its true pose in the mesh file's frame."""

    mesh: Mesh
    pose: Pose
    image: NDArray


@pytest.fixture(scope="session")
def network() -> NetworkPolicy:
    """The shipped network."""
    return load_policy()


@pytest.fixture(scope="session")
def box() -> Mesh:
    """A box with a colour a side, off its file's origin."""
    return meshes.colored_box((0.1, 0.07, 0.05), offset=(0.02, 0.0, -0.01))


@pytest.fixture(scope="session")
def seen(box: Mesh) -> Picture:
    """The box to the right of the image's middle."""
    turn = exp_so3(torch.tensor([0.5, 0.7, 0.2], dtype=torch.float64))
    centred = Pose(turn, torch.tensor([0.05, -0.02, 0.4], dtype=torch.float64))
    image = pictures.picture(box, centred).permute(1, 2, 0).contiguous().numpy()
    return Picture(box, box.outer(centred), image)


@pytest.fixture(scope="session")
def store() -> TemplateStore:
    """Templates are made once for all tests."""
    return TemplateStore()


@pytest.fixture
def detector(box: Mesh, network: NetworkPolicy, store: TemplateStore) -> PoseDetector:
    """Looks for the box in images of `pictures.CAMERA`."""
    return PoseDetector(
        box, pictures.CAMERA, config=SMALL, policy=network, renderer=make_renderer(), store=store
    )
