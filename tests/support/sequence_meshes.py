"""Declared symmetries and meshes far from their origin, for sequence folders; tests only."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch

from moveit6d.datasets.pose_files import POSE_COLUMNS, PoseRow, read_poses, write_poses
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose

FAR = (500.0, 0.0, 0.0)
# The upright axis through the middle of the brick (tests/conftest.py), millimetres.
AXIS = {"symmetries_continuous": [{"axis": [0, 0, 1], "offset": [30, -10, 20]}]}


def assert_has_axis(mesh: Mesh) -> None:
    """That a mesh has the symmetry of `AXIS` alone."""
    (axis,) = mesh.symmetries.continuous
    np.testing.assert_allclose(axis.offset, [0.03, -0.01, 0.02], atol=1e-12)


def far_from_origin(folder: Path) -> list[Pose]:
    """Move the mesh of a folder of `make_sequence` 500 m from its origin; its new true poses."""
    near = Mesh.load(folder / "mesh.ply")
    colors = (near.vertex_colors / 255).tolist() if near.vertex_colors is not None else []
    points = (near.vertices + near.center + FAR).tolist()
    lines = [
        f"v {x} {y} {z} {r} {g} {b}" for (x, y, z), (r, g, b) in zip(points, colors, strict=True)
    ]
    lines += [f"f {a} {b} {c}" for a, b, c in near.faces + 1]
    (folder / "mesh.ply").unlink()
    (folder / "mesh.obj").write_text("\n".join(lines))
    (folder / "start.json").unlink(missing_ok=True)
    rows = [
        PoseRow(row.frame, row.image, moved(row.pose))
        for row in read_poses(folder / "poses.csv")
        if row.pose is not None
    ]
    write_poses(folder / "poses.csv", rows, ("frame", "image", *POSE_COLUMNS))
    return [row.pose for row in rows if row.pose is not None]


def moved(pose: Pose) -> Pose:
    """The pose of an object whose mesh was moved by `FAR`."""
    shift = torch.tensor(FAR, dtype=torch.float64)
    return Pose(pose.rotation, pose.translation - pose.rotation @ shift)
