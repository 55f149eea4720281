"""Write your own renderer: here one that draws a surface as many points, the nearest one wins.

    python examples/my_own_renderer.py
    python examples/my_own_renderer.py --mesh drill.glb --mesh_unit m

A renderer turns meshes, poses and intrinsics into albedo, normal, depth and mask; everything else
(light, network, tracking) works on those. This compares the points with embree and tracks a made
clip with both.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from moveit6d import (
    InputError,
    Mesh,
    Pose,
    PoseTracker,
    TrackerConfig,
    load_policy,
    make_renderer,
)
from moveit6d.config import RecoveryConfig
from moveit6d.geometry.crop import PATCH_SIZE, look_at
from moveit6d.rendering.renderer import GBuffer, Renderer, check_batch, gather
from moveit6d.synthesis.objects.demo_object import demo_object
from moveit6d.synthesis.sequences.sequence import Scene

Float = NDArray[np.float64]


class PointRenderer:
    """Any object with this name, `render` and what it returns is a renderer."""

    name = "points"

    def __init__(self, count: int = 150_000) -> None:
        self.count = count
        self._clouds: WeakKeyDictionary[Mesh, tuple[Float, Float, Any]] = WeakKeyDictionary()

    def render(
        self, meshes: Sequence[Mesh], poses: Pose, intrinsics: Tensor, size: int = PATCH_SIZE
    ) -> GBuffer:
        """One patch for each mesh; `gather` makes tensors of what `draw` returns."""
        check_batch(meshes, poses, intrinsics, size)
        return gather(self.draw, meshes, poses, intrinsics, size)

    def draw(
        self, mesh: Mesh, rotation: Float, translation: Float, intrinsics: Float, size: int
    ) -> tuple[Any, Any, Any]:
        """Albedo (H, W, 3) uint8, normal (H, W, 3) and depth (H, W) of one patch."""
        if mesh not in self._clouds:
            self._clouds[mesh] = sample(mesh, self.count)
        points, normals, colors = self._clouds[mesh]
        seen = points @ rotation.T + translation
        turned = normals @ rotation.T
        turned *= -np.sign((turned * seen).sum(1, keepdims=True))  # towards the camera
        pixels = np.rint((seen @ intrinsics.T)[:, :2] / seen[:, 2:]).astype(int)
        inside = ((pixels >= 0) & (pixels < size)).all(1) & (seen[:, 2] > 0)
        # The farthest first, so that of all points in a pixel the nearest is written last.
        order = np.flatnonzero(inside)[np.argsort(-seen[inside, 2])]
        x, y = pixels[order].T
        albedo = np.zeros((size, size, 3), np.uint8)
        normal = np.zeros((size, size, 3), np.float32)
        depth = np.zeros((size, size), np.float32)
        albedo[y, x], normal[y, x], depth[y, x] = colors[order], turned[order], seen[order, 2]
        return albedo, normal, depth


def sample(mesh: Mesh, count: int) -> tuple[Float, Float, Any]:
    """Points (N, 3) in the centred frame, normals (N, 3) and RGB (N, 3), evenly by area."""
    random = np.random.default_rng(0)
    corners = mesh.vertices[mesh.faces].astype(np.float64)  # (F, 3, 3)
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(across, axis=1)
    face = random.choice(len(area), count, p=area / area.sum())
    shares = random.dirichlet((1, 1, 1), count)[..., None]  # (N, 3, 1): evenly on a triangle
    points = (corners[face] * shares).sum(1)
    normals = (mesh.corner_normals[face] * shares).sum(1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    if mesh.texture is None or mesh.uv is None:
        assert mesh.vertex_colors is not None
        colors = (mesh.vertex_colors[mesh.faces[face]] * shares).sum(1)
        return points, normals, colors.round().astype(np.uint8)
    height, width = mesh.texture.shape[:2]
    u, v = (mesh.uv[mesh.faces[face]] * shares).sum(1).T % 1
    row = np.minimum(((1 - v) * height).astype(int), height - 1)  # v counts from below
    return points, normals, mesh.texture[row, np.minimum((u * width).astype(int), width - 1)]


def main(arguments: Sequence[str] | None = None) -> None:
    """Compare with embree, then track with both."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--mesh", type=Path, help="the object; none: a toy robot")
    parser.add_argument(
        "--mesh_unit", choices=("m", "cm", "mm", "in"), default="m", help="the mesh's unit"
    )
    parser.add_argument("--frames", type=int, default=15, help="of the clip that is tracked")
    parser.add_argument("--weights", type=Path, help="weights file instead of the shipped one")
    args = parser.parse_args(arguments)

    mesh = demo_object() if args.mesh is None else Mesh.load(args.mesh, args.mesh_unit)
    scene = Scene(mesh, seed=2, frames=args.frames, difficulty="easy")
    shots = [scene.render_frame(number) for number in range(args.frames)]
    renderers: list[Renderer] = [make_renderer("embree"), PointRenderer()]

    one, two = (patch(renderer, mesh, shots[0].pose) for renderer in renderers)
    both = (one.mask > 0) & (two.mask > 0)
    either = (one.mask > 0) | (two.mask > 0)
    print(
        f"first frame: masks agree to {100 * float(both.sum() / either.sum()):.1f} %, depth to "
        f"{1000 * float((one.depth - two.depth)[both].abs().median()):.2f} mm, colours to "
        f"{float((one.albedo - two.albedo).abs().median()):.3f} (medians)"
    )
    # Looking for a lost object would draw it from a thousand sides, with points in minutes.
    config = TrackerConfig(recovery=RecoveryConfig(enabled=False))
    for renderer in renderers:
        policy = load_policy(args.weights)
        tracker = PoseTracker(
            mesh, scene.camera, shots[0].pose, policy=policy, renderer=renderer, config=config
        )
        found = [tracker.update(rendered.image) for rendered in shots[1:]]
        errors = [
            1000 * float((result.pose.translation - rendered.pose.translation).norm())
            for result, rendered in zip(found, shots[1:], strict=True)
            if result.pose is not None
        ]
        pace = float(np.median([result.milliseconds for result in found]))
        print(f"{renderer.name}: mean error {np.mean(errors):.1f} mm, {pace:.0f} ms a frame")


def patch(renderer: Renderer, mesh: Mesh, pose: Pose) -> GBuffer:
    """What the network would be shown at this pose (mesh file's frame)."""
    inner = mesh.inner(pose)
    batch = Pose(inner.rotation[None], inner.translation[None])
    view = look_at(batch, batch.translation.new_tensor([mesh.sphere_diameter]))
    return renderer.render([mesh], view.to_virtual(batch), view.intrinsics)


if __name__ == "__main__":
    try:
        main()
    except InputError as error:
        sys.exit(f"my_own_renderer: {error}")
