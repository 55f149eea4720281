"""Rasterising with OpenGL through pyrender, on a GPU or in software: EGL, OSMesa or a window.

Never lights anything: one flat pass says which face each pixel sees and how deep, and normals and
colours come from the same interpolation as every other back end's, so that pictures are alike.
"""

from __future__ import annotations

import ctypes
import ctypes.util
import functools
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from threading import Lock
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from ..errors import InputError, RenderingUnavailable
from ..extras import require
from ..geometry.crop import PATCH_SIZE
from ..geometry.mesh import Mesh
from ..geometry.pose import Pose
from ..typing import Float32
from .attributes import Attributes, pixel_rays
from .renderer import GBuffer, check_batch, gather

VARIABLE = "PYOPENGL_PLATFORM"  # where PyOpenGL and pyrender look for "egl" or "osmesa"
WINDOW = "window"  # what a missing variable means
HELP = (
    "On Debian or Ubuntu install libegl1 and libgl1 (EGL, with or without a graphics card), or "
    "libosmesa6. The default renderer, embree, needs none of them."
)
_LOCK = Lock()  # threads take turns: there is one OpenGL context
Arrays = tuple[NDArray[np.uint8], Float32, Float32]


class PyrenderRenderer:
    """One OpenGL pass for each patch; both sides of every triangle are visible."""

    name = "pyrender"

    def __init__(self) -> None:
        self._offscreen, self.platform = _open()
        import pyrender

        self._pyrender = pyrender
        self._scene = pyrender.Scene(bg_color=(0, 0, 0, 0))
        self._camera = pyrender.IntrinsicsCamera(1, 1, 0, 0)
        self._scene.add(self._camera, pose=np.diag([1.0, -1.0, -1.0, 1.0]))  # OpenGL looks along -z
        self._nodes: WeakKeyDictionary[Mesh, Any] = WeakKeyDictionary()

    def render(
        self, meshes: Sequence[Mesh], poses: Pose, intrinsics: Tensor, size: int = PATCH_SIZE
    ) -> GBuffer:
        """One patch for each mesh; see `Renderer`."""
        check_batch(meshes, poses, intrinsics, size)
        with _LOCK:
            kept = set(self._nodes.values())
            for node in self._scene.mesh_nodes - kept:  # their meshes are gone
                self._scene.remove_node(node)
            return gather(self._render_one, meshes, poses, intrinsics, size)

    def _render_one(
        self,
        mesh: Mesh,
        rotation: NDArray[np.float64],
        translation: NDArray[np.float64],
        intrinsics: NDArray[np.float64],
        size: int,
    ) -> Arrays:
        albedo = np.zeros((size * size, 3), np.uint8)
        normal = np.zeros((size * size, 3), np.float32)
        face, depth = self._visible(mesh, rotation, translation, intrinsics, size)
        pixel = np.flatnonzero(face >= 0)
        if len(pixel):
            rays = pixel_rays(pixel, intrinsics, size)
            u, v = _barycentric(mesh, face[pixel], rays, rotation, translation)
            attributes = Attributes.of(mesh)
            normals, values = attributes.at(face[pixel], u, v, rays, rotation.astype(np.float32))
            normal[pixel] = normals.T
            albedo[pixel] = attributes.colour(values, intrinsics, float(translation[2]))
        shape = (size, size)
        return albedo.reshape(*shape, 3), normal.reshape(*shape, 3), depth.reshape(shape)

    def _visible(
        self,
        mesh: Mesh,
        rotation: NDArray[np.float64],
        translation: NDArray[np.float64],
        intrinsics: NDArray[np.float64],
        size: int,
    ) -> tuple[NDArray[np.intp], Float32]:
        """For each pixel (H·W) the face that it sees, or −1, and the depth."""
        reach = 0.51 * mesh.sphere_diameter
        far = float(translation[2]) + reach
        near = max(far - 2 * reach, 1e-3 * mesh.sphere_diameter)
        if far <= near:
            return np.full(size * size, -1), np.zeros(size * size, np.float32)
        (fx, skew, cx), (_, fy, cy) = intrinsics[:2]
        camera = self._camera
        camera.fx, camera.fy, camera.znear, camera.zfar = fx, fy, near, far
        camera.cx, camera.cy = cx + 0.5, cy + 0.5  # OpenGL counts from the first pixel's corner
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = rotation, translation
        pose[0] += skew / fx * pose[1]  # pyrender knows no skew; a sheared object looks the same
        self._scene.set_pose(self._node(mesh), pose)
        colour, depth = self._pass(size)
        code = colour.astype(np.intp) @ (1, 256, 65536)
        return code.reshape(-1) - 1, np.array(depth, np.float32).reshape(-1)

    def _node(self, mesh: Mesh) -> Any:
        """The scene's node of this mesh, which becomes the only visible one."""
        node = self._nodes.get(mesh)
        if node is None:
            code = np.repeat(np.arange(1, len(mesh.faces) + 1), 3)  # 0 is the background
            colour = np.stack([code & 255, code >> 8 & 255, code >> 16], axis=-1) / 255
            material = self._pyrender.MetallicRoughnessMaterial(doubleSided=True)
            primitive = self._pyrender.Primitive(
                positions=mesh.vertices[mesh.faces.reshape(-1)],
                color_0=colour.astype(np.float32),
                material=material,
            )
            node = self._scene.add(self._pyrender.Mesh([primitive]))
            self._nodes[mesh] = node
        for other in self._scene.mesh_nodes:
            other.mesh.is_visible = other is node
        return node

    def _pass(self, size: int) -> tuple[NDArray[np.uint8], Float32]:
        offscreen = self._offscreen
        offscreen.viewport_width = offscreen.viewport_height = size
        with _environment(self.platform), _one_sample():
            try:
                colour, depth = offscreen.render(self._scene, self._pyrender.RenderFlags.FLAT)
            finally:
                _leave(offscreen)
        return colour, depth


def _barycentric(
    mesh: Mesh,
    face: NDArray[np.intp],
    rays: Float32,
    rotation: NDArray[np.float64],
    translation: NDArray[np.float64],
) -> tuple[Float32, Float32]:
    """Where rays (3, N) from the camera meet the planes of faces (N,): u and v, each (N,).

    Kept inside of the face, which OpenGL may leave by a rounding error.
    """
    towards = rays.T @ rotation  # (N, 3), in the object's frame
    corners = mesh.vertices[mesh.faces[face]].astype(np.float64)  # (N, 3, 3)
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    from_corner = -translation @ rotation - corners[:, 0]
    across = np.cross(towards, second)
    volume = (first * across).sum(1)
    volume = np.where(np.abs(volume) < 1e-18, 1e-18, volume)  # seen exactly from the side
    u = ((from_corner * across).sum(1) / volume).clip(0, 1)
    v = ((towards * np.cross(from_corner, first)).sum(1) / volume).clip(0, 1 - u)
    return u.astype(np.float32), v.astype(np.float32)


@functools.cache
def _open() -> tuple[Any, str]:
    """pyrender's off-screen renderer and its platform, one for the whole process.

    One, because PyOpenGL can be bound to a single platform in a process, and because closing one
    EGL context of pyrender's closes the display under all others.
    """
    try:
        require("gl", "The pyrender renderer")
    except InputError as error:
        raise RenderingUnavailable(str(error)) from None
    platform = _platform()
    try:
        with _environment(platform):
            import pyrender

            if platform == "osmesa":
                _complete_osmesa()
            offscreen = pyrender.OffscreenRenderer(PATCH_SIZE, PATCH_SIZE)
            _leave(offscreen)
            return offscreen, platform
    except Exception as error:  # missing libraries and drivers fail in a hundred ways
        raise RenderingUnavailable(
            f"The pyrender renderer found no OpenGL through {platform} "
            f"({type(error).__name__}: {error}). {HELP}"
        ) from error


def _leave(offscreen: Any) -> None:
    """Free an EGL context from this thread, so that another one may draw; pyrender keeps it."""
    display = getattr(offscreen._platform, "_egl_display", None)
    if display is not None:
        from OpenGL import EGL

        nothing = EGL.EGL_NO_SURFACE
        EGL.eglMakeCurrent(display, nothing, nothing, EGL.EGL_NO_CONTEXT)


def _platform() -> str:
    """What the user asked for, or else the first that can work: EGL, OSMesa, a window."""
    chosen = os.environ.get(VARIABLE)
    if chosen:
        return chosen
    if _egl_has_device():
        return "egl"
    if ctypes.util.find_library("OSMesa"):
        return "osmesa"
    if os.environ.get("DISPLAY") or not sys.platform.startswith("linux"):
        return WINDOW
    raise RenderingUnavailable(
        f"The pyrender renderer found no OpenGL on this machine: neither EGL nor OSMesa, and no "
        f"display for a window. {HELP}"
    )


def _egl_has_device() -> bool:
    """Whether EGL and OpenGL are installed and a graphics card or a software driver answers."""
    name = ctypes.util.find_library("EGL")
    if name is None or not ctypes.util.find_library("GL"):
        return False
    try:
        library = ctypes.CDLL(name)
    except OSError:
        return False
    library.eglGetProcAddress.restype = ctypes.c_void_p
    address = library.eglGetProcAddress(b"eglQueryDevicesEXT")
    if not address:
        return False
    query = ctypes.CFUNCTYPE(ctypes.c_uint, ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)(address)
    count = ctypes.c_int(0)
    return bool(query(0, None, ctypes.byref(count))) and count.value > 0


def _complete_osmesa() -> None:
    """Give PyOpenGL 3.1.0, which pyrender insists on, the OSMesa calls that pyrender makes."""
    import OpenGL.osmesa as osmesa
    from OpenGL import platform

    if hasattr(osmesa, "OSMesaCreateContextAttribs"):
        return
    osmesa.OSMesaContext.__hash__ = lambda context: hash(context.address)
    create = platform.PLATFORM.OSMesa.OSMesaCreateContextAttribs
    create.restype = osmesa.OSMesaContext
    create.argtypes = [ctypes.c_void_p, ctypes.c_void_p]
    osmesa.OSMesaCreateContextAttribs = lambda attributes, shared: create(
        np.ascontiguousarray(attributes, np.int32).ctypes.data, shared
    )
    constants = {
        "OSMESA_DEPTH_BITS": 0x30,
        "OSMESA_PROFILE": 0x33,
        "OSMESA_CORE_PROFILE": 0x34,
        "OSMESA_CONTEXT_MAJOR_VERSION": 0x36,
        "OSMESA_CONTEXT_MINOR_VERSION": 0x37,
    }
    for name, value in constants.items():
        setattr(osmesa, name, value)


@contextmanager
def _environment(platform: str) -> Iterator[None]:
    """The variable that PyOpenGL and pyrender read, set for the moment and then as it was."""
    before = os.environ.get(VARIABLE)
    if platform == WINDOW:
        os.environ.pop(VARIABLE, None)
    else:
        os.environ[VARIABLE] = platform
    try:
        yield
    finally:
        os.environ.pop(VARIABLE, None)
        if before is not None:
            os.environ[VARIABLE] = before


@contextmanager
def _one_sample() -> Iterator[None]:
    """pyrender blends four samples a pixel, which would mix the numbers of faces; ask for one."""
    import pyrender.renderer as module

    four = module.glRenderbufferStorageMultisample
    module.glRenderbufferStorageMultisample = lambda target, samples, *rest: four(target, 0, *rest)
    try:
        yield
    finally:
        module.glRenderbufferStorageMultisample = four
