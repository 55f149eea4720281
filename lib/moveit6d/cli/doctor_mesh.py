"""`moveit6d doctor --mesh FILE`: says and shows what was understood of a mesh file.

Never changes the file.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from .apart import check_apart

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ..geometry.mesh import Mesh, Unit
    from ..geometry.mesh_files.content import MeshContent


def run(path: Path, unit: Unit | None, output: Path | None) -> int:
    """Print what was understood and write the picture; 2 if a part of the looks is lost."""
    import numpy as np

    from ..geometry.mesh import METRES, Mesh
    from ..geometry.mesh_files import read_mesh_file
    from ..geometry.symmetry_file import symmetries_beside

    picture = Path(f"{path.stem}_sides.png") if output is None else output
    check_apart({"--output": [picture]}, [path])
    surface, content = read_mesh_file(path, allow_untextured=True)
    points = surface.vertices[np.unique(surface.faces)]
    chosen, why = _unit(np.ptp(points, axis=0).max(), content, unit)
    other = content.other_unit(METRES[chosen])
    mesh = Mesh.from_surface(str(path), surface, chosen, symmetries_beside(path))
    extent = np.ptp(mesh.vertices.astype(np.float64), axis=0)
    lines = [
        ("file", f"{path}, {path.stat().st_size:,} bytes"),
        ("unit", f"{chosen} ({why})"),
        ("size", " × ".join(f"{value:.4g}" for value in extent) + " m (x, y, z)"),
        *_ranges(points, chosen),
        ("diameter", f"{mesh.diameter:.4g} m"),
        ("faces", f"{len(mesh.faces):,} of {len(mesh.vertices):,} vertices"),
        ("looks", _looks(mesh)),
        *(("material", text) for text in _materials(content)),
        ("symmetry", _symmetry(mesh)),
        *([("note", other)] if other else []),
        *(("note", text) for text in content.notes),
        *(("LOST", text) for text in content.warnings),
    ]
    for name, text in lines:
        print(f"  {name:10} {text}")
    _draw(mesh, picture)
    print(f"  {'picture':10} {picture}")
    return 2 if content.warnings else 0


def _unit(size: float, content: MeshContent, unit: Unit | None) -> tuple[Unit, str]:
    """The unit and where it is known from: the option, the file, or which ones make sense."""
    from ..geometry.mesh import METRES, SIZES

    names: tuple[Unit, ...] = ("m", "cm", "mm", "in")
    if unit is not None:
        return unit, "as given"
    if content.unit is not None:
        for name in names:
            if abs(METRES[name] - content.unit) < 1e-6:
                return name, "as the file says"
    fitting = [name for name in names if SIZES[0] <= size * METRES[name] <= SIZES[1]]
    if not fitting:
        raise InputError(
            f"{content.path}: it is {size:.4g} units across, which is no size in "
            f"{', '.join(names)}; scale it."
        )
    found = ", ".join(f"{size * METRES[name]:.4g} m with {name}" for name in fitting)
    return fitting[0], f"guessed: give --mesh_unit; it would be {found}"


def _ranges(points: NDArray[Any], unit: Unit) -> list[tuple[str, str]]:
    """From where to where the surface reaches along each axis: where the file's origin is."""
    from ..geometry.mesh import METRES

    lines = []
    for axis, low, high in zip("xyz", points.min(0).tolist(), points.max(0).tolist(), strict=True):
        text = f"{low:.4g} to {high:.4g} {unit}"
        if unit != "m":
            text += f" ({low * METRES[unit]:.4g} to {high * METRES[unit]:.4g} m)"
        lines.append((axis, text))
    return lines


def _looks(mesh: Mesh) -> str:
    import numpy as np

    if mesh.texture is not None:
        height, width = mesh.texture.shape[:2]
        return f"texture of {width}×{height} pixels"
    assert mesh.vertex_colors is not None
    count = len(np.unique(mesh.vertex_colors, axis=0))
    if count == 1:
        color = tuple(int(value) for value in mesh.vertex_colors[0])
        return f"one flat colour, RGB {color}: a track of it is less sure"
    return f"{count:,} different vertex colours"


def _materials(content: MeshContent) -> list[str]:
    found = []
    for material in content.materials:
        if material.picture:
            shown = f"{material.picture}, {material.size[0]}×{material.size[1]} pixels"
        else:
            shown = "no picture" + (f", RGB {material.color}" if material.color else "")
        found.append(f"{material.name or '(without a name)'}: {shown}")
    return found[:20] + ([f"and {len(found) - 20} more"] if len(found) > 20 else [])


def _symmetry(mesh: Mesh) -> str:
    if mesh.symmetries.is_trivial:
        return "none declared"
    discrete, axes = len(mesh.symmetries.discrete), len(mesh.symmetries.continuous)
    return f"{discrete} discrete, {axes} axes"


def _draw(mesh: Mesh, path: Path) -> None:
    from PIL import Image

    from ..io import replacing
    from ..rendering.backends import make_renderer
    from ..visualization.six_sides import six_sides

    with replacing(path) as temporary:
        Image.fromarray(six_sides(mesh, make_renderer())).save(temporary, "PNG")
