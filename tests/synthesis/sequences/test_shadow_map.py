"""Objects shade themselves: on the side that is turned away from the light, and only there."""

from __future__ import annotations

import numpy as np
import torch

from moveit6d.geometry.camera import Camera
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.rendering.backends import make_renderer
from moveit6d.synthesis.sequences.layers import (
    SceneLight,
    SceneMaterial,
    composite,
    render_layers,
)
from tests.support.meshes import colored_box

CAMERA = Camera(300.0, 310.0, 98.3, 75.1, 200, 150)


def test_shadow_falls_away_from_the_light() -> None:
    # A pole on a plate, lit from the left: the plate is dark on the right of the pole only.
    plate, pole = colored_box((0.2, 0.2, 0.01)), colored_box((0.02, 0.02, 0.08))
    raised = pole.vertices + np.array([0, 0, -0.045], np.float32)
    whole = Mesh.from_arrays(
        "sundial",
        np.concatenate([plate.vertices, raised]),
        np.concatenate([plate.faces, pole.faces + len(plate.vertices)]),
    )
    pose = Pose(
        torch.eye(3, dtype=torch.float64)[None],
        torch.tensor([[0.0, 0.0, 0.6]], dtype=torch.float64),
    )
    light = SceneLight((-0.707, 0.0, -0.707), (1.0, 1.0, 1.0), (0.2, 0.2, 0.2))
    matte = SceneMaterial(0.0, 0.0)
    (layer,) = render_layers(
        make_renderer("embree"),
        whole,
        pose,
        CAMERA,
        np.zeros((1, 2)),
        light,
        matte,
    )
    frame, depth = np.zeros((150, 200, 3), np.float32), np.full((150, 200), np.inf, np.float32)
    composite(frame, depth, layer)
    u, v = (round(c) for c in CAMERA.project(torch.tensor([0.0, 0.0, 0.6])).tolist())
    left, right = frame[v, u - 20, 0], frame[v, u + 20, 0]
    assert left > 3 * right > 0
