"""glTF and GLB: every triangle of the scene, where its nodes, skins and weights put it.

Never plays animations. Specification: Khronos, glTF 2.0.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from .compression import draco_attributes
from .content import MeshContent, MeshPart
from .gltf_buffers import REMEDY, GltfFile, open_gltf
from .gltf_materials import Looks

MAX_NODES = 100_000
TRIANGLES, STRIP, FAN = 4, 5, 6

Matrix = NDArray[np.float64]
Hidden = tuple[str, Callable[[], MeshPart | None]]  # an invisible material, and what makes the part


def read_gltf(content: MeshContent) -> None:
    """Add the parts of a glTF or GLB file to `content`; its numbers are metres by definition."""
    file = open_gltf(content.path)
    content.unit = 1.0
    looks = Looks(file, content)
    placed, visible = dict[int, Matrix](), list[int]()
    for node, matrix, is_visible in _placed(file):
        placed[node] = matrix  # of hidden ones, too: they may be joints
        visible += [node] * is_visible
    hidden: list[Hidden] = []
    for node in visible:
        matrix, entry = placed[node], file.items("nodes")[node]
        if "EXT_mesh_gpu_instancing" in (entry.get("extensions") or {}):
            raise InputError(f"{file.path} uses EXT_mesh_gpu_instancing; {REMEDY}.")
        if entry.get("mesh") is None:
            continue
        mesh = file.items("meshes")[entry["mesh"]]
        weights = entry.get("weights") or mesh.get("weights") or []
        joints = None if entry.get("skin") is None else _joints(file, entry["skin"], placed)
        for primitive in mesh["primitives"]:
            make = partial(_part, file, primitive, weights, matrix, joints, looks)
            name = looks.invisible(primitive.get("material"))
            if name is not None:
                hidden.append((name, make))
                continue
            part = make()
            if part is not None:
                content.parts.append(part)
    _add_hidden(content, hidden)


def _add_hidden(content: MeshContent, hidden: list[Hidden]) -> None:
    """Primitives of invisible materials stay out, but where nothing else is they are shown."""
    names = ", ".join(sorted({repr(name) for name, _ in hidden}))
    if not hidden:
        return
    if any(len(part.faces) for part in content.parts):
        content.notes.append(f"faces of materials that alpha makes invisible stay out: {names}")
        return
    content.warnings.append(
        f"alpha makes all of its materials invisible ({names}); they are shown as if solid"
    )
    made = [make() for _, make in hidden]
    content.parts += [part for part in made if part is not None]


def _placed(file: GltfFile) -> Iterator[tuple[int, Matrix, bool]]:
    """The nodes of the scene, their matrices (4, 4) to the world, and whether they are visible."""
    nodes, scenes = file.items("nodes"), file.items("scenes")
    if scenes:
        roots = scenes[file.json.get("scene") or 0].get("nodes") or []
    else:  # without a scene: all nodes that are nobody's child
        children = {child for node in nodes for child in node.get("children") or []}
        roots = [index for index in range(len(nodes)) if index not in children]
    waiting = [(int(root), np.eye(4), True) for root in roots]
    seen: set[int] = set()
    while waiting:
        index, above, visible = waiting.pop()
        if index in seen or len(seen) > MAX_NODES:
            raise InputError(f"{file.path}: node {index} hangs below two others or itself.")
        seen.add(index)
        node = nodes[index]
        matrix = above @ _local(node)
        said = (node.get("extensions") or {}).get("KHR_node_visibility") or {}
        visible = visible and said.get("visible") is not False
        yield index, matrix, visible
        waiting += [(int(child), matrix, visible) for child in node.get("children") or []]


def _local(node: dict[str, Any]) -> Matrix:
    if node.get("matrix") is not None:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T
    x, y, z, w = np.array(node.get("rotation") or (0, 0, 0, 1), np.float64)
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    matrix = np.eye(4)
    matrix[:3, :3] = turn * np.array(node.get("scale") or (1, 1, 1), np.float64)
    matrix[:3, 3] = np.array(node.get("translation") or (0, 0, 0), np.float64)
    return matrix


def _joints(file: GltfFile, skin: int, placed: dict[int, Matrix]) -> NDArray[np.float64]:
    """The matrices (J, 4, 4) of a skin's joints in the pose that the file was saved in."""
    entry = file.items("skins")[skin]
    matrices = np.stack([placed.get(joint, np.eye(4)) for joint in entry["joints"]])
    if entry.get("inverseBindMatrices") is None:
        return matrices
    inverse = file.accessor(entry["inverseBindMatrices"]).reshape(-1, 4, 4).swapaxes(1, 2)
    return np.asarray(matrices @ inverse[: len(matrices)])


def _part(
    file: GltfFile, primitive: dict[str, Any], weights: list[float], matrix: Matrix,
    joints: NDArray[np.float64] | None, looks: Looks,
) -> MeshPart | None:  # fmt: skip
    """One primitive in the scene's frame; None for points and lines."""
    mode = primitive.get("mode", TRIANGLES)
    if mode not in (TRIANGLES, STRIP, FAN):
        return None
    attributes, faces = _attributes(file, primitive)
    points = np.asarray(attributes["POSITION"], np.float64)[:, :3]
    for weight, target in zip(weights, primitive.get("targets") or [], strict=False):
        if "POSITION" in target:
            points = points + float(weight) * file.accessor(target["POSITION"])
    if faces is None:
        faces = np.arange(len(points), dtype=np.int64)
    triangles = _triangles(faces, mode)
    if triangles.size and (triangles.min() < 0 or triangles.max() >= len(points)):
        raise InputError(f"{file.path}: a face names a vertex that is not there ({len(points)}).")
    bones = None if joints is None else _bones(attributes)
    if joints is not None and bones is not None:
        share = bones[1] / np.maximum(bones[1].sum(1, keepdims=True), 1e-12)
        mixed = np.einsum("vk,vkij->vij", share, joints[bones[0]])
        points = np.einsum("vij,vj->vi", mixed[:, :3, :3], points) + mixed[:, :3, 3]
    else:
        points = points @ matrix[:3, :3].T + matrix[:3, 3]
        if np.linalg.det(matrix[:3, :3]) < 0:
            triangles = triangles[:, ::-1]
    part = MeshPart(points, np.ascontiguousarray(triangles))
    return looks.applied(part, primitive.get("material"), attributes)


def _bones(
    attributes: dict[str, NDArray[Any]],
) -> tuple[NDArray[np.int64], NDArray[np.float64]] | None:
    """Joints and weights (V, 4 for each set) of all sets; None where there are none."""
    pairs: list[tuple[NDArray[Any], NDArray[Any]]] = []
    while {f"JOINTS_{len(pairs)}", f"WEIGHTS_{len(pairs)}"} <= set(attributes):
        pairs.append((attributes[f"JOINTS_{len(pairs)}"], attributes[f"WEIGHTS_{len(pairs)}"]))
    if not pairs:
        return None
    joints, weights = (np.concatenate(one, axis=1) for one in zip(*pairs, strict=True))
    return joints.astype(np.int64), weights.astype(np.float64)


def _attributes(
    file: GltfFile, primitive: dict[str, Any]
) -> tuple[dict[str, NDArray[Any]], NDArray[np.int64] | None]:
    """Attributes by name, and the indices, decompressed where necessary."""
    extension = (primitive.get("extensions") or {}).get("KHR_draco_mesh_compression")
    if extension is not None:
        return draco_attributes(file, primitive, extension)
    found = {
        # Colours keep their type, which decides what they mean.
        name: file.accessor(index, normalize=not name.startswith("COLOR"))
        for name, index in primitive["attributes"].items()
        if name == "POSITION" or name.split("_")[0] in ("TEXCOORD", "COLOR", "JOINTS", "WEIGHTS")
    }
    if primitive.get("indices") is None:
        return found, None
    return found, file.accessor(primitive["indices"], normalize=False).reshape(-1).astype(np.int64)


def _triangles(indices: NDArray[np.int64], mode: int) -> NDArray[np.int64]:
    if mode == TRIANGLES:
        return indices[: len(indices) // 3 * 3].reshape(-1, 3)
    count = max(len(indices) - 2, 0)
    k = np.arange(count)
    if mode == FAN:
        return np.stack([np.repeat(indices[:1], count), indices[k + 1], indices[k + 2]], -1)
    odd = k % 2
    return np.stack([indices[k], indices[k + 1 + odd], indices[k + 2 - odd]], -1)
