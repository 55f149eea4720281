"""Instances: which poses are one, which meshes are one, and two tracks of one mesh."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from moveit6d import Mesh, Pose, PoseTracker
from moveit6d.estimation.detection import PoseDetector, SearchRegion, TemplateStore
from moveit6d.estimation.detection.instances import (
    first_of_instances,
    is_same_instance,
    same_meshes,
)
from moveit6d.estimation.detection.steps import finish
from moveit6d.policies import NetworkPolicy
from tests.estimation.detection.conftest import SMALL, Picture
from tests.support import pictures


def at(x: float, z: float = 0.4) -> Pose:
    return Pose(torch.eye(3).double(), torch.tensor([x, 0.0, z], dtype=torch.float64))


def test_poses_are_one_instance_within_a_share_of_the_nearer_width(box: Mesh) -> None:
    camera, width = pictures.CAMERA, 0.4 * box.sphere_diameter
    assert is_same_instance(box, camera, at(0.0), at(0.99 * width), 0.4)
    assert not is_same_instance(box, camera, at(0.0), at(1.01 * width), 0.4)
    # Behind it, as far aside in the image: the nearer one's width counts.
    assert is_same_instance(box, camera, at(0.0), at(1.9 * width, 0.8), 0.4)
    kept = first_of_instances(box, camera, [at(0.0), at(0.5 * width), at(2 * width)], 0.4)
    assert kept == [0, 2]


def test_a_mesh_read_twice_is_one_mesh(box: Mesh) -> None:
    again, wider = replace(box), replace(box, vertices=1.1 * box.vertices)
    assert same_meshes([box, wider, again, box]) == [[2, 3], [], [0, 3], [0, 2]]


def test_a_copy_under_another_name_is_the_same_and_one_of_another_print_is_not(box: Mesh) -> None:
    copy = replace(box, name="another", vertices=box.vertices.copy())
    assert box.vertex_colors is not None
    printed = replace(box, vertex_colors=255 - box.vertex_colors)
    plain = replace(box, vertex_colors=None)
    assert same_meshes([box, copy, printed, plain]) == [[1], [0], [], []]


@pytest.fixture(scope="module")
def truths(seen: Picture) -> list[Pose]:
    """Centred poses of the two boxes in `both`."""
    right = seen.mesh.inner(seen.pose)
    left = Pose(right.rotation, right.translation * torch.tensor([-1.6, 0.0, 1.0]))
    return [right, left]


@pytest.fixture(scope="module")
def both(seen: Picture, truths: list[Pose]) -> torch.Tensor:
    """A picture of two boxes, (256, 256, 3)."""
    return pictures.picture(seen.mesh, truths[1], seen.image).permute(1, 2, 0).contiguous()


def test_a_search_finds_who_is_not_taken(
    seen: Picture, detector: PoseDetector, truths: list[Pose], both: torch.Tensor
) -> None:
    free, likelier = truths
    region = SearchRegion(taken=(seen.mesh.outer(likelier),))
    found = finish(detector.steps(both, region, region.taken, most=16)).pose
    assert found is not None
    assert float((seen.mesh.inner(found).translation - free.translation).norm()) < 0.02


def test_two_tracks_of_one_mesh_are_two_instances(
    seen: Picture,
    network: NetworkPolicy,
    store: TemplateStore,
    truths: list[Pose],
    both: torch.Tensor,
) -> None:
    tracker = PoseTracker(
        [seen.mesh, replace(seen.mesh)], pictures.CAMERA, policy=network, config=SMALL, store=store
    )
    found = [one.pose for one in tracker.update(both)]
    places = [seen.mesh.inner(pose).translation for pose in found if pose is not None]
    assert len(places) == 2
    for truth in truths:
        assert min(float((place - truth.translation).norm()) for place in places) < 0.02
