"""The object's surface, loaded once and centred, with its sizes, colours, normals and symmetries.

Never renders.
"""

from __future__ import annotations

import itertools
import logging
import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..checks import shown
from ..config import TextureConfig
from ..errors import InputError
from ..typing import ImageLike
from .camera import Camera
from .half_turn import half_turns
from .hull import convex_hull
from .inputs import instance_of
from .mesh_files import read_mesh_file
from .mesh_files.join import PLAIN, Surface
from .normals import smooth_normals
from .numbers import float64_of
from .pose import Pose
from .symmetry import SAME_TURN, Symmetries
from .symmetry_file import symmetries_beside

Unit = Literal["m", "cm", "mm", "in"]
METRES: dict[str, float] = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254}
TEXTURE = TextureConfig()
LOG = logging.getLogger("moveit6d")
SIZES = (0.005, 20.0)  # metres: smaller or larger objects are unit mistakes


@dataclass(frozen=True, eq=False)
class Mesh:
    """A surface of triangles, in metres, in a frame centred on its bounding sphere.

    Users' poses belong to the mesh file's own frame; `inner` and `outer` go between the two:
    X_file = X_centred + center. Exactly one of `texture` (with `uv`) and `vertex_colors` is set.
    Two meshes are equal only if they are the same object.
    """

    name: str
    vertices: NDArray[np.float32]  # (V, 3), centred
    faces: NDArray[np.int32]  # (F, 3)
    normals: NDArray[np.float32]  # (V, 3), smooth across everything
    corner_normals: NDArray[np.float32]  # (F, 3, 3), smooth but for creases: what is rendered
    center: NDArray[np.float64]  # (3,), the bounding sphere's centre in the file's frame
    sphere_diameter: float  # of the bounding sphere: the size that crops go by
    diameter: float  # largest distance of two vertices: the size that evaluation goes by
    uv: NDArray[np.float32] | None = None  # (V, 2), OpenGL's convention: v points up
    texture: NDArray[np.uint8] | None = None  # (H, W, 3) RGB
    vertex_colors: NDArray[np.uint8] | None = None  # (V, 3) RGB
    symmetries: Symmetries = field(default_factory=Symmetries)  # in the file's frame

    @staticmethod
    def load(
        path: str | Path,
        unit: Unit = "m",
        symmetries: Symmetries | None = None,
        allow_untextured: bool = False,
        allow_flat: bool = False,
    ) -> Mesh:
        """Read OBJ, PLY, GLB/glTF, Collada, STL or OFF; `unit` is what the file's numbers mean.

        Symmetries that are not given are those declared in a file beside it (`symmetry_file`).
        `InputError` if the file names a picture, material or colour that cannot be shown, or is of
        one flat colour although it names some; with `allow_untextured` that is logged as a warning,
        with `allow_flat` (for data sets, whose files mean what they say) only the flat colour is.
        """
        path = Path(path)
        surface, content = read_mesh_file(path, allow_untextured, allow_flat)
        for warning in content.warnings:
            LOG.warning("%s: %s", path, warning)
        known = symmetries_beside(path) if symmetries is None else symmetries
        mesh = Mesh.from_surface(str(path), surface, unit, known)
        other = content.other_unit(METRES[unit])
        if other is not None:
            LOG.warning("%s: %s; it is %.3g m across", path, other, mesh.diameter)
        return mesh

    @staticmethod
    def from_surface(name: str, surface: Surface, unit: Unit, symmetries: Symmetries) -> Mesh:
        """From what a mesh file holds, under the file's name without folder and suffix.

        See `from_arrays`.
        """
        mesh = Mesh.from_arrays(
            name,
            surface.vertices,
            surface.faces,
            uv=surface.uv,
            texture=surface.texture,
            vertex_colors=surface.colors,
            unit=unit,
            symmetries=symmetries,
        )
        return replace(mesh, name=Path(name).stem)

    @staticmethod
    def from_arrays(
        name: str,
        vertices: Any,
        faces: Any,
        *,
        uv: Any = None,
        texture: Any = None,
        vertex_colors: Any = None,
        unit: Unit = "m",
        symmetries: Symmetries | None = None,
    ) -> Mesh:
        """From vertices (V, 3) in `unit` and faces (F, 3), with their colours.

        Those are uv (V, 2) and a texture (H, W, 3) uint8, or vertex_colors (V, 3) uint8, or
        neither (plain grey). `InputError` where something cannot be right.

        >>> corners = [[0, 0, 0], [100, 0, 0], [0, 100, 0], [0, 0, 100]]
        >>> faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
        >>> mesh = Mesh.from_arrays("corner", corners, faces, unit="mm")
        >>> round(mesh.diameter, 4)
        0.1414
        """
        if unit not in METRES:
            raise InputError(f"{name}: the unit is {unit!r}, must be one of {', '.join(METRES)}.")
        remedy = "Symmetries(discrete) makes one of motions (S, 4, 4)"
        known = Symmetries() if symmetries is None else symmetries
        known = instance_of(known, Symmetries, "object's symmetries", remedy)
        points, triangles = _checked(name, vertices, faces)
        used, triangles = _used(triangles, len(points))
        points = points[used] * METRES[unit]
        uv, texture, colors = _appearance(name, len(used), used, uv, texture, vertex_colors)
        center, diameter = bounding_sphere(points)
        _check_size(name, diameter, unit)
        normals, corner_normals = smooth_normals(points, triangles)
        return Mesh(
            name=str(name),
            vertices=np.ascontiguousarray(points - center, np.float32),
            faces=np.ascontiguousarray(triangles, np.int32),
            normals=normals.astype(np.float32),
            corner_normals=corner_normals.astype(np.float32),
            center=center,
            sphere_diameter=diameter,
            diameter=largest_distance(points),
            uv=uv,
            texture=texture,
            vertex_colors=colors,
            symmetries=known,
        )

    def inner(self, pose: Pose) -> Pose:
        """The centred frame's pose, given the file frame's (any batch shape); shares no memory."""
        return Pose(pose.rotation.clone(), pose.translation + self._moved_center(pose))

    def outer(self, pose: Pose) -> Pose:
        """The file frame's pose, given the centred frame's (any batch shape); shares no memory."""
        return Pose(pose.rotation.clone(), pose.translation - self._moved_center(pose))

    def scaled(self, factor: float) -> Mesh:
        """This mesh so many times as large, about its bounding sphere's centre.

        `InputError` if the factor is not positive and finite.

        >>> corners = [[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]]
        >>> mesh = Mesh.from_arrays("corner", corners, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
        >>> larger = mesh.scaled(1.1)
        >>> round(larger.diameter / mesh.diameter, 4), bool((larger.center == mesh.center).all())
        (1.1, True)
        """
        if not 0 < factor < math.inf:
            raise InputError(f"{self.name}: a mesh cannot be scaled by {factor}.")
        if factor == 1:
            return self
        return replace(
            self,
            vertices=(self.vertices * factor).astype(np.float32),
            sphere_diameter=self.sphere_diameter * factor,
            diameter=self.diameter * factor,
        )

    @cached_property
    def motions(self) -> NDArray[np.float64]:
        """Motions (S, 4, 4) of the centred frame that leave its looks unchanged, identity first."""
        return self.closed_symmetries.centred(self.center)

    @cached_property
    def closed_symmetries(self) -> Symmetries:
        """With all products of the declared ones, wherever they were (`Symmetries.closed`)."""
        return self.symmetries.closed()

    @cached_property
    def half_turns(self) -> NDArray[np.float64]:
        """Motions (3, 4, 4) of the centred frame: half turns about the axes of the smallest box.

        Without those that are symmetries.
        """
        turns = half_turns(self.vertices.astype(np.float64))
        if self.symmetries.is_trivial:
            return turns
        # Motions that turn an object alike and leave its looks unchanged are the same one.
        apart = np.linalg.norm((turns[:, None] - self.motions)[..., :3, :3], axis=(2, 3))
        return np.asarray(turns[apart.min(1) > math.sqrt(2) * SAME_TURN])

    @property
    def has_colours(self) -> bool:
        """Whether the surface has a texture or colours, not just one flat colour as CAD files."""
        colours = self.vertex_colors if self.texture is None else self.texture.reshape(-1, 3)
        return colours is not None and bool((colours != colours[:1]).any())

    def textured_from(
        self, image: ImageLike, pose: Pose, camera: Camera, config: TextureConfig = TEXTURE
    ) -> Mesh:
        """This mesh painted with what an image shows of it, for a mesh without colours.

        `image` (H, W, 3) is RGB, uint8 or floating point in [0, 1], as the camera took it: of a
        camera with a lens through that lens, of an undistorted image (`Camera.undistort`) it is
        the pinhole camera. `pose` is object → camera in the mesh file's frame, metres. The sides
        that are not seen take the mean colour. Raises `InputError` if the image does not fit the
        camera or too little is seen.
        """
        from .projected_texture import paint

        return paint(self, image, pose, camera, config)

    def sample_points(self, count: int, seed: int = 0) -> NDArray[np.float64]:
        """Points on the surface, evenly by area, in the file's frame: (count, 3) metres."""
        random = np.random.default_rng(seed)
        a, b, c = (self.vertices[self.faces[:, k]].astype(np.float64) for k in range(3))
        area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
        face = random.choice(len(area), count, p=area / area.sum())
        u, v = random.random((2, count, 1))
        u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
        a, b, c = a[face], b[face], c[face]
        return np.asarray(a + u * (b - a) + v * (c - a) + self.center)

    def _moved_center(self, pose: Pose) -> torch.Tensor:
        return pose.rotation @ torch.from_numpy(self.center).to(pose.rotation)


def sphere_diameters(meshes: Iterable[Mesh]) -> Tensor:
    """Of the bounding spheres of meshes, metres, float64: (B,)."""
    return torch.tensor([mesh.sphere_diameter for mesh in meshes], dtype=torch.float64)


def bounding_sphere(points: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """Centre (3,) and diameter of the smallest sphere around points (N, 3).

    Exact: the smallest sphere around a few points grows by the farthest point of all until none
    is left outside, and at most four points hold it at any time.
    """
    support = points[:1]
    center, radius = support[0], 0.0
    for _ in range(1000):  # a dozen are usual
        distance = np.linalg.norm(points - center, axis=1)
        farthest = int(distance.argmax())
        if distance[farthest] <= radius * (1 + 1e-9):
            break
        support, center, radius = _sphere_of_few(np.vstack([support, points[farthest]]))
    return center, 2 * float(np.linalg.norm(points - center, axis=1).max())


def largest_distance(points: NDArray[np.float64]) -> float:
    """The largest distance between two of the points (N, 3).

    Exact up to 8,000 corners of the convex hull; shapes with more are round, and the largest of
    many sweeps to the farthest corner and back stands for it (wrong by less than 0.1 %).
    """
    corners = convex_hull(points)
    corners = corners - corners.mean(0)  # near zero, where the product below loses no digits
    square = (corners * corners).sum(1)
    rows = np.arange(len(corners))
    if len(corners) > 8000:
        starts = rows[:: len(corners) // 256]
        rows = np.unique((square - 2 * corners[starts] @ corners.T).argmax(1))  # the farthest
    blocks = np.array_split(rows, len(rows) // 256 + 1)
    largest = max(
        float((square[block, None] + square - 2 * corners[block] @ corners.T).max())
        for block in blocks
        if len(block)
    )
    return math.sqrt(max(largest, 0.0))


def _sphere_of_few(
    points: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """The smallest sphere around up to five points: those that hold it, its centre and radius."""
    best = (points, points.mean(0), np.inf)
    for count in range(2, min(len(points), 4) + 1):
        for chosen in itertools.combinations(range(len(points)), count):
            support = points[list(chosen)]
            edges = support[1:] - support[0]
            offset = np.linalg.lstsq(2 * edges, (edges * edges).sum(1), rcond=None)[0]
            center, radius = support[0] + offset, float(np.linalg.norm(offset))
            reach = np.linalg.norm(points - center, axis=1).max()
            if reach <= radius * (1 + 1e-9) and radius < best[2]:
                best = (support, center, radius)
    return best


def _checked(name: str, vertices: Any, faces: Any) -> tuple[NDArray[Any], NDArray[Any]]:
    points, triangles = float64_of(vertices, name, "vertices").numpy(), _array(name, faces, "faces")
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"{name}: vertices must be (V, 3), found {points.shape}.")
    if triangles.size == 0:
        raise InputError(f"{name}: the mesh has no faces; a surface of triangles is needed.")
    if triangles.ndim != 2 or triangles.shape[1] != 3 or triangles.dtype.kind not in "iu":
        raise InputError(f"{name}: faces must be integers (F, 3), found {triangles.shape}.")
    triangles = triangles.astype(np.int64)
    if triangles.min() < 0 or triangles.max() >= len(points):
        raise InputError(f"{name}: a face names a vertex that is not there ({len(points)} are).")
    used = points[np.unique(triangles)]  # what no face uses is dropped
    bad = ~np.isfinite(used).all(axis=1)
    if bad.any():
        raise InputError(
            f"{name}: {int(bad.sum())} vertices are not finite numbers; repair the mesh, or remove "
            "the faces that use them."
        )
    a, b, c = (points[triangles[:, k]] for k in range(3))
    with np.errstate(over="ignore", invalid="ignore"):
        area = float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())
        size = float(np.ptp(used, axis=0).max())
        visible = area > 1e-9 * size * size
    if not visible and size > 0:
        raise InputError(f"{name}: its faces have no area, so that nothing of it can be seen.")
    return points, triangles


def _array(name: str, values: Any, what: str) -> NDArray[Any]:
    """An array of whatever holds numbers; its type is the caller's to check."""
    try:
        return np.asarray(values.detach().cpu() if isinstance(values, Tensor) else values)
    except (TypeError, ValueError):  # rows of different lengths
        raise InputError(f"{name}: the {what} must be an array, found {shown(values)}.") from None


def _used(faces: NDArray[Any], count: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """The vertices that faces use, and the faces renumbered to them."""
    used = np.zeros(count, bool)
    used[faces] = True
    return np.flatnonzero(used), (np.cumsum(used) - 1)[faces]


def _appearance(
    name: str, count: int, used: NDArray[Any], uv: Any, texture: Any, colors: Any
) -> tuple[NDArray[np.float32] | None, NDArray[np.uint8] | None, NDArray[np.uint8] | None]:
    if (texture is None) != (uv is None):
        raise InputError(f"{name}: a texture and texture coordinates are needed together.")
    if texture is None:
        plain = np.full((count, 3), PLAIN, np.uint8)
        return None, None, plain if colors is None else _colors(name, colors, used)
    if colors is not None:
        raise InputError(f"{name}: give a texture or vertex colours, not both.")
    texture = _array(name, texture, "texture")
    uv = float64_of(uv, name, "texture coordinates").numpy().astype(np.float32)
    if texture.ndim != 3 or texture.shape[2] != 3 or texture.dtype != np.uint8 or not texture.size:
        raise InputError(f"{name}: the texture must be (H, W, 3) uint8, found {texture.shape}.")
    if uv.ndim != 2 or uv.shape[1] != 2 or len(uv) <= used[-1] or not np.isfinite(uv[used]).all():
        raise InputError(f"{name}: texture coordinates must be finite (V, 2), found {uv.shape}.")
    return np.ascontiguousarray(uv[used]), np.ascontiguousarray(texture), None


def _colors(name: str, colors: Any, used: NDArray[Any]) -> NDArray[np.uint8]:
    values = _array(name, colors, "vertex colours")
    if values.ndim != 2 or values.shape[1] != 3 or len(values) <= used[-1]:
        raise InputError(f"{name}: vertex colours must be (V, 3), found {values.shape}.")
    if values.dtype != np.uint8:
        raise InputError(f"{name}: vertex colours must be uint8, found {values.dtype}.")
    return np.ascontiguousarray(values[used])


def _check_size(name: str, diameter: float, unit: str) -> None:
    low, high = SIZES
    if low <= diameter <= high:
        return
    found = f"{name}: with unit {unit!r} the object is {diameter:.3g} m across"
    raw = diameter / METRES[unit]
    fitting = [repr(other) for other, metres in METRES.items() if low <= raw * metres <= high]
    if fitting:
        raise InputError(f"{found}: the file looks like unit {' or '.join(fitting)}, state that.")
    raise InputError(f"{found}, outside of {low} m to {high} m; scale the mesh to metres.")
