"""The container of a glTF file: its JSON, its buffers, and accessors as arrays.

Never knows meshes or materials. Specification: Khronos, glTF 2.0, sections 3.6 and 4.
"""

from __future__ import annotations

import base64
import json
import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import unquote_to_bytes

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from .beside import find_beside, read_bytes
from .compression import MESHOPT, meshopt_view

TYPES = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
MOST_ELEMENTS = 200_000_000
# Extensions that change the geometry or the looks and are understood here, or change neither.
UNDERSTOOD = {
    "KHR_texture_transform", "KHR_materials_pbrSpecularGlossiness", "KHR_mesh_quantization",
    "KHR_draco_mesh_compression", *MESHOPT, "EXT_texture_webp", "EXT_texture_avif",
    "MSFT_texture_dds", "KHR_materials_unlit", "KHR_lights_punctual", "KHR_xmp_json_ld", "KHR_xmp",
    "KHR_materials_variants", "KHR_animation_pointer", "KHR_node_visibility",
}  # fmt: skip
REMEDY = "export the file without it (Blender: glTF 2.0 with default settings)"


@dataclass
class GltfFile:
    """A glTF file's JSON and how to get at what it refers to."""

    path: Path
    json: dict[str, Any]
    binary: bytes | None  # of a GLB
    _buffers: dict[int, bytes] = field(default_factory=dict)

    def items(self, name: str) -> list[dict[str, Any]]:
        """A top-level list of the JSON, empty where it is missing."""
        return self.json.get(name) or []

    def buffer(self, index: int) -> bytes:
        """The bytes of a buffer: in the GLB, in the JSON or in a file beside it."""
        if index not in self._buffers:
            entry = self.items("buffers")[index]
            if "uri" in entry:
                self._buffers[index] = self.resource(entry["uri"], f"buffer {index}")
            elif index == 0 and self.binary is not None:
                self._buffers[index] = self.binary
            else:
                raise InputError(f"{self.path}: buffer {index} has no data; {REMEDY}.")
        return self._buffers[index]

    def view(self, index: int) -> bytes:
        """The bytes of a buffer view, decompressed where necessary."""
        entry = self.items("bufferViews")[index]
        for name in MESHOPT:
            packed = (entry.get("extensions") or {}).get(name)
            if packed is not None:
                return meshopt_view(self.path, packed, self._part(packed, index))
        return self._part(entry, index)

    def _part(self, entry: dict[str, Any], index: int) -> bytes:
        """The bytes of a buffer that an entry of buffer view `index` names."""
        start, length = entry.get("byteOffset", 0), entry["byteLength"]
        content = self.buffer(entry["buffer"])
        if start < 0 or length < 0 or start + length > len(content):
            raise InputError(
                f"{self.path} is cut off or damaged: buffer view {index} ends at byte "
                f"{start + length} of {len(content)}."
            )
        return content[start : start + length]

    def accessor(self, index: int, normalize: bool = True) -> NDArray[Any]:
        """An accessor as (N, W): normalised integers as fractions, others as they are."""
        entry = self.items("accessors")[index]
        count, width = int(entry["count"]), WIDTHS[entry["type"]]
        kind = np.dtype(TYPES[entry["componentType"]])
        if not 0 <= count * width <= MOST_ELEMENTS:
            raise InputError(f"{self.path}: accessor {index} says it has {count} elements.")
        if entry.get("bufferView") is None:
            values = np.zeros((count, width), kind)
        else:
            view = self.items("bufferViews")[entry["bufferView"]]
            values = self._strided(
                self.view(entry["bufferView"]), entry.get("byteOffset", 0), count, width, kind,
                int(view.get("byteStride") or 0), index,
            )  # fmt: skip
        if entry.get("sparse"):
            values = self._sparse(values, entry["sparse"], kind, width)
        if entry.get("normalized") and normalize and kind.kind in "iu":
            return np.maximum(values / float(np.iinfo(kind).max), -1.0)
        return values

    def resource(self, uri: str, what: str) -> bytes:
        """The bytes that a URI means: data in the text, or a file beside the mesh."""
        if uri.startswith("data:"):
            head, _, data = uri.partition(",")
            return base64.b64decode(data) if head.endswith(";base64") else unquote_to_bytes(data)
        found = find_beside(self.path, uri)
        if found is None:
            raise InputError(f"{self.path}: {what} is the file {uri[:200]!r}, which is not there.")
        return read_bytes(found)

    def _strided(
        self, content: bytes, offset: int, count: int, width: int, kind: np.dtype[Any],
        stride: int, index: int,
    ) -> NDArray[Any]:  # fmt: skip
        size = width * kind.itemsize
        stride = stride or size
        if offset < 0 or (count and offset + (count - 1) * stride + size > len(content)):
            raise InputError(
                f"{self.path} is cut off or damaged: accessor {index} reaches beyond its data."
            )
        if stride == size:
            return np.frombuffer(content, kind, count * width, offset).reshape(count, width)
        rows = np.lib.stride_tricks.as_strided(
            np.frombuffer(content, np.uint8, offset=offset), (count, size), (stride, 1)
        )
        return np.ascontiguousarray(rows).view(kind)

    def _sparse(
        self, values: NDArray[Any], sparse: dict[str, Any], kind: np.dtype[Any], width: int
    ) -> NDArray[Any]:
        count, values = int(sparse["count"]), values.copy()
        where, what = sparse["indices"], sparse["values"]
        rows = np.frombuffer(
            self.view(where["bufferView"]), TYPES[where["componentType"]], count,
            where.get("byteOffset", 0),
        )  # fmt: skip
        new = np.frombuffer(
            self.view(what["bufferView"]), kind, count * width, what.get("byteOffset", 0)
        )
        values[rows] = new.reshape(count, width)
        return values


def open_gltf(path: Path) -> GltfFile:
    """Open a .glb or .gltf; `InputError` where it is cut off, of another version or needs an
    extension that is not understood."""
    content, binary = read_bytes(path), None
    if content[:4] == b"glTF":
        text, binary = _chunks(content, path)
    else:
        text = content
    try:
        data = json.loads(text.decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: cannot be read as glTF ({str(error)[:100]}).") from error
    if not isinstance(data, dict) or not isinstance(data.get("asset"), dict):
        raise InputError(f"{path}: cannot be read as glTF (it has no asset).")
    if not str(data["asset"].get("version", "2.0")).startswith("2"):
        raise InputError(f"{path} is glTF {data['asset']['version']}; convert it to glTF 2.0.")
    required = data.get("extensionsRequired") or []
    unknown = sorted(str(name) for name in required if name not in UNDERSTOOD)
    if unknown:
        raise InputError(f"{path} requires {', '.join(unknown)}, not understood here; {REMEDY}.")
    return GltfFile(path, data, binary)


def _chunks(content: bytes, path: Path) -> tuple[bytes, bytes | None]:
    """The JSON and the binary chunk of a GLB."""
    if len(content) < 20:
        raise InputError(f"{path}: cannot be read as glTF (it ends in its header).")
    _, version, length = struct.unpack("<III", content[:12])
    if version != 2:
        raise InputError(f"{path}: cannot be read as glTF (container version {version}, not 2).")
    if length > len(content):
        raise InputError(f"{path} is cut off: {len(content)} of {length} bytes are there.")
    found: dict[bytes, bytes] = {}
    place = 12
    while place + 8 <= length:
        size, kind = struct.unpack("<I4s", content[place : place + 8])
        if place + 8 + size > len(content):
            raise InputError(f"{path} is cut off in a chunk of {size} bytes.")
        found.setdefault(kind, content[place + 8 : place + 8 + size])
        place += 8 + size + (-size % 4)
    if b"JSON" not in found:
        raise InputError(f"{path}: cannot be read as glTF (it has no JSON chunk).")
    return found[b"JSON"], found.get(b"BIN\0")
