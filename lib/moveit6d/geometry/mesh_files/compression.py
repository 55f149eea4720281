"""Compressed meshes: Draco through the package DracoPy, meshopt through the package meshopt.

Never decodes anything by itself; what cannot be decoded is refused by name.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError

if TYPE_CHECKING:
    from .gltf_buffers import GltfFile

# Both have the same layout; the second has a newer codec, which the decoder tells by itself.
MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")
MOST_MESHOPT = 1024  # bytes that one compressed byte can stand for: 2 bits a column of 256 rows


def draco_attributes(
    file: GltfFile, primitive: dict[str, Any], extension: dict[str, Any]
) -> tuple[dict[str, NDArray[Any]], NDArray[np.int64]]:
    """Attributes by name and indices of a primitive under KHR_draco_mesh_compression."""
    try:
        import DracoPy
    except ImportError as error:
        raise InputError(
            f"{file.path} is compressed with Draco; pip install 'moveit6d[draco]', or export it "
            "without compression."
        ) from error
    try:
        mesh = DracoPy.decode(file.view(extension["bufferView"]))
    except (ValueError, RuntimeError) as error:  # DracoPy's own errors are ValueErrors
        raise InputError(f"{file.path}: its Draco data is damaged ({error}).") from error
    stored = {entry["unique_id"]: np.asarray(entry["data"]) for entry in mesh.attributes}
    found: dict[str, NDArray[Any]] = {}
    for name, number in extension["attributes"].items():
        values = stored[number]
        values = values.reshape(len(values), -1)
        accessor = file.items("accessors")[primitive["attributes"][name]]
        normalized = accessor.get("normalized") and not name.startswith("COLOR")
        if normalized and values.dtype.kind in "iu":
            values = np.maximum(values / float(np.iinfo(values.dtype).max), -1.0)
        found[name] = values
    return found, np.asarray(mesh.faces, np.int64).reshape(-1)


def meshopt_view(path: Path, extension: dict[str, Any], content: bytes) -> bytes:
    """The bytes of a buffer view that `extension` (one of `MESHOPT`) says is compressed."""
    try:
        import meshopt
    except ImportError as error:
        raise InputError(
            f"{path} is compressed with meshopt; pip install 'moveit6d[meshopt]', or export it "
            "without compression."
        ) from error
    count, stride = int(extension["count"]), int(extension["byteStride"])
    if not 0 <= count * stride <= MOST_MESHOPT * (len(content) + 32):
        raise InputError(
            f"{path}: {len(content)} bytes of meshopt data cannot hold {count} rows of {stride}."
        )
    mode, kept = extension["mode"], extension.get("filter", "NONE")
    try:
        found = meshopt.decode_gltf_buffer(content, count, stride, mode, kept)
    except (ValueError, RuntimeError) as error:
        raise InputError(f"{path}: its meshopt data is damaged ({error}).") from error
    return np.asarray(found).tobytes()
