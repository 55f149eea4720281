"""Reads a mesh file by its suffix, and makes sure that its looks were not lost on the way.

Never knows a format by itself.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from .collada import read_collada
from .content import ALLOW, MeshContent, MeshPart
from .gltf import read_gltf
from .join import Surface, join
from .obj import read_obj
from .off import read_off
from .ply import read_ply
from .stl import read_stl

READERS: dict[str, Callable[[MeshContent], None]] = {
    ".obj": read_obj, ".ply": read_ply, ".glb": read_gltf, ".gltf": read_gltf, ".stl": read_stl,
    ".off": read_off, ".dae": read_collada,
}  # fmt: skip
SUFFIXES = tuple(READERS)
# Texture coordinates beyond this are damage; float32 cannot tell texels apart there.
FARTHEST_UV = 1e5
VERTEX_COLOURS = "vertex colours"  # as readers name them
GREYISH = 24  # of 255, between the channels of a colour that is none


def read_mesh_file(
    path: Path, allow_untextured: bool = False, allow_flat: bool = False
) -> tuple[Surface, MeshContent]:
    """Every triangle of a mesh file in its own frame and unit, and what was understood of it.

    A picture, material or colour that the file names and that cannot be shown is an `InputError`,
    or one of the content's warnings with `allow_untextured`. So is a file that names any of them
    and still comes out in one flat colour, for which `allow_flat` is enough.
    """
    reader = READERS.get(path.suffix.lower())
    try:
        there = path.exists()
    except OSError:  # too long a name
        there = False
    if not there:
        raise InputError(f"{path}: there is no such mesh file.")
    if reader is None:
        raise InputError(f"{path}: a mesh must be one of {', '.join(SUFFIXES)}.")
    content = MeshContent(path, allow_untextured, allow_flat)
    try:
        with np.errstate(all="ignore"):
            reader(content)
            _check_parts(content)
            surface = join(content.parts)
            content.warnings += surface.warnings
    except InputError as error:
        raise error if str(path) in str(error) else InputError(f"{path}: {error}") from error
    except MemoryError as error:
        raise InputError(f"{path}: needs more memory than there is.") from error
    except Exception as error:  # readers trust the file and stumble over what is wrong in it
        reason = " ".join(str(error).split())[:120]
        raise InputError(
            f"{path}: cannot be read as a mesh ({type(error).__name__}: {reason})."
        ) from error
    _check_looks(content, surface)
    return surface, content


def _check_parts(content: MeshContent) -> None:
    content.parts = [_of_faces(part) for part in content.parts if len(part.faces)]
    if not content.parts:
        raise InputError(f"{content.path}: holds no faces; a mesh of triangles is needed.")
    for part in content.parts:
        listed = [values for values in (part.uv, part.colors) if values is not None]
        if any(len(values) != len(part.vertices) for values in listed):
            raise InputError(
                f"{content.path}: it has not as many texture coordinates or colours as vertices; "
                "export it again."
            )
        if part.uv is not None and not (np.abs(part.uv).max(initial=0) <= FARTHEST_UV):
            raise InputError(
                f"{content.path}: it has texture coordinates that are not finite or far outside of "
                "the picture; export it again."
            )


def _of_faces(part: MeshPart) -> MeshPart:
    """The part without the vertices that no face uses, where some are not finite numbers."""
    values = [one for one in (part.vertices, part.uv, part.colors) if one is not None]
    named = part.faces.min() >= 0 and part.faces.max() < min(map(len, values))
    if not named or all(np.isfinite(one).all() for one in values):
        return part
    used, faces = np.unique(part.faces, return_inverse=True)
    return replace(
        part,
        vertices=part.vertices[used],
        faces=faces.reshape(-1, 3),
        uv=None if part.uv is None else part.uv[used],
        colors=None if part.colors is None else part.colors[used],
    )


def _check_looks(content: MeshContent, surface: Surface) -> None:
    """The check that always holds: whatever names looks is not one flat colour."""
    shown = _shown(surface)
    if not content.named or not (shown == shown[:1]).all():
        return
    some = ", ".join(content.named[:4]) + (" and more" if len(content.named) > 4 else "")
    color = tuple(int(value) for value in shown[0])
    what = f"it names {some}, but the whole object is of one colour, RGB {color}"
    if content.allow_untextured or content.allow_flat or _means_it(content, shown[0]):
        content.warnings.append(what)
        return
    raise InputError(
        f"{content.path}: {what}; if it has no texture, {ALLOW.replace('without it', 'with that')}."
    )


def _means_it(content: MeshContent, color: NDArray[np.uint8]) -> bool:
    """Whether every vertex says one and the same colour, and none that stands for no colour.

    A red toy's scan does; white and grey are what programs write where they have lost the colours.
    """
    return content.named == [VERTEX_COLOURS] and int(np.ptp(color.astype(int))) > GREYISH


def _shown(surface: Surface) -> NDArray[np.uint8]:
    """The colours (N, 3) that can be seen: of a texture those that faces lie on."""
    if surface.texture is None or surface.uv is None:
        assert surface.colors is not None
        return surface.colors
    height, width = surface.texture.shape[:2]
    corners = surface.uv[surface.faces] * (width, height)  # (F, 3, 2) texels
    if ((corners.max(1) - corners.min(1)) > 1).any():
        return surface.texture.reshape(-1, 3)
    x, y = (np.floor(corners[..., k]).astype(np.int64) for k in (0, 1))  # palettes, and no layout
    return np.asarray(surface.texture[(height - 1 - y) % height, x % width].reshape(-1, 3))
