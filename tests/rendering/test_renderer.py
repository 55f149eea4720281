"""What every back end does alike: batches are their parts, wrong ones are refused."""

import pytest
import torch

from moveit6d.errors import InputError
from moveit6d.geometry.pose import Pose
from tests.support import meshes
from tests.support.drawing import RENDERER


def test_a_batch_is_its_parts():
    parts = [meshes.colored_box(), meshes.l_shape(), meshes.colored_box()]
    views = [meshes.view(mesh, seed, size=64) for seed, mesh in enumerate(parts)]
    poses = Pose(
        torch.cat([pose.rotation for pose, _ in views]),
        torch.cat([pose.translation for pose, _ in views]),
    )
    whole = RENDERER.render(parts, poses, torch.cat([k for _, k in views]), 64)
    assert whole.albedo.shape == whole.normal.shape == (3, 3, 64, 64)
    assert whole.depth.shape == whole.mask.shape == (3, 1, 64, 64)
    for b, (mesh, (pose, intrinsics)) in enumerate(zip(parts, views, strict=True)):
        one = RENDERER.render([mesh], pose, intrinsics, 64)
        for name in ("albedo", "normal", "depth", "mask"):
            value = getattr(whole, name)
            assert value.dtype == torch.float32 and value.is_contiguous()
            torch.testing.assert_close(value[b], getattr(one, name)[0])


def test_wrong_batches_are_refused():
    mesh = meshes.colored_box()
    pose, intrinsics = meshes.view(mesh)
    with pytest.raises(InputError, match="2 meshes need 2 poses"):
        RENDERER.render([mesh, mesh], pose, intrinsics)
    with pytest.raises(InputError, match=r"intrinsics \(1, 3, 3\)"):
        RENDERER.render([mesh], pose, intrinsics[0])
    with pytest.raises(InputError, match="size"):
        RENDERER.render([mesh], pose, intrinsics, size=0)
