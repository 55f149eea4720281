"""STL: binary, with the face colours that VisCAM and Magics put into it, and ASCII.

Never guesses a unit.
"""

from __future__ import annotations

import io
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from .beside import read_bytes
from .content import MeshContent, MeshPart
from .join import PLAIN

RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
HEAD = 84  # bytes before the first triangle


def read_stl(content: MeshContent) -> None:
    """Add the part of an STL file to `content`."""
    data = read_bytes(content.path)
    count = int.from_bytes(data[80:84], "little") if len(data) >= HEAD else -1
    more = len(data) - HEAD - RECORD.itemsize * count
    named = data[:5].lower() == b"solid" and b"facet" in data.lower()
    if count < 0 or more < 0 or (more > 0 and named):
        _ascii(content, data, count)
        return
    rows = _all_rows(content, data, count)
    points = rows["corners"].reshape(-1, 3).astype(np.float64)
    part = MeshPart(points, np.arange(len(points)).reshape(-1, 3))
    colors = _colors(content, rows["attribute"], data[:80])
    if colors is not None:
        content.name("face colours")
        part.colors = np.repeat(colors, 3, axis=0)
    content.parts.append(part)


def _all_rows(content: MeshContent, data: bytes, count: int) -> NDArray[Any]:
    """The triangles that the header counts, and those behind them if nothing else is there."""
    rows = np.frombuffer(data, RECORD, (len(data) - HEAD) // RECORD.itemsize, HEAD)
    behind = rows["corners"][count:]
    whole = len(data) == HEAD + rows.nbytes
    if not (whole and len(behind) and np.isfinite(behind).all() and behind.any((1, 2)).all()):
        return rows[:count]
    content.warnings.append(
        f"its header counts {count} triangles, but {len(rows)} are there; all are read"
    )
    return rows


def _colors(
    content: MeshContent, attribute: NDArray[np.uint16], head: bytes
) -> NDArray[np.uint8] | None:
    """Colours (F, 3) of five bits a channel; None where the attributes hold none."""
    five = np.stack([attribute & 31, attribute >> 5 & 31, attribute >> 10 & 31], -1)
    own = attribute >> 15 == 0
    at = head.find(b"COLOR=")
    if at >= 0 and len(head) >= at + 10:  # Magics: red in the low bits, the highest means "none"
        whole = np.frombuffer(head[at + 6 : at + 9], np.uint8)
        return np.where(own[:, None], np.rint(five * 255 / 31), whole).astype(np.uint8)
    if own.all():  # VisCAM sets the highest bit and has blue in the low bits
        return None
    if own.any():
        content.warnings.append(
            f"{int(own.sum())} of {len(own)} faces have no colour and are shown grey"
        )
    return np.where(own[:, None], PLAIN, np.rint(five[:, ::-1] * 255 / 31)).astype(np.uint8)


def _ascii(content: MeshContent, data: bytes, count: int) -> None:
    import trimesh

    data = data.lower().replace(b"\r\n", b"\n").replace(b"\r", b"\n")  # some write SOLID and FACET
    if b"facet" not in data:
        size = HEAD + RECORD.itemsize * max(count, 0)
        raise InputError(
            f"{content.path}: cannot be read as STL: cut off or damaged ({len(data)} bytes, "
            f"{size} are needed)."
        )
    if b"endsolid" not in data[-1000:]:
        raise InputError(f"{content.path} is cut off: its last line is not endsolid.")
    scene = trimesh.load_scene(io.BytesIO(data), file_type="stl_ascii", process=False)
    for mesh in scene.dump():
        if len(getattr(mesh, "faces", ())):
            content.parts.append(MeshPart(np.array(mesh.vertices), np.array(mesh.faces)))
