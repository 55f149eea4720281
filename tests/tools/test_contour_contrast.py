"""The contrast along an outline is highest where the object is."""

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest
import torch

from moveit6d.actions import PoseAction
from moveit6d.frame import Frame
from moveit6d.geometry.crop import look_at
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.rendering.backends import make_renderer
from tests.support import pictures

TOOLS = Path(__file__).parents[2] / "tools"
TRUTH = Pose(torch.eye(3).double(), torch.tensor([0.02, -0.01, 0.5], dtype=torch.float64))


@pytest.fixture
def tool() -> ModuleType:
    spec = importlib.util.spec_from_file_location("tool", TOOLS / "contour_contrast.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("axis", range(6))
@pytest.mark.parametrize("sign", [-1, 1])
def test_a_pose_beside_the_true_one_has_less(
    tool: ModuleType, brick: Mesh, axis: int, sign: int
) -> None:
    frame = Frame(pictures.picture(brick, TRUTH), pictures.CAMERA)
    diameter = torch.tensor(brick.sphere_diameter, dtype=torch.float64)
    view = look_at(TRUTH, diameter)
    delta = torch.zeros(6, dtype=torch.float64)
    delta[axis] = sign * (2.0 if axis < 3 else 5.0)
    beside = PoseAction.from_delta(delta).apply_centred(TRUTH, diameter)
    there, here = (
        tool.contrast(frame, brick, brick.outer(pose), view, make_renderer())
        for pose in (beside, TRUTH)
    )
    assert there < 0.95 * here
