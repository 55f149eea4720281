"""A box with 24 patches of known colour, its files, and how many patches a mesh shows right.

The reference is OpenCV's projection: never the library's own way from texture to pixel.
"""

from __future__ import annotations

import io
import json
import struct
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from PIL import Image
from scipy.spatial.transform import Rotation

from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.rendering.embree import EmbreeRenderer

HALF = np.array([0.05, 0.04, 0.03])
CELL = 32  # texels a side; each side of the box shows four patches of half that
LEVELS = np.array([30, 140, 250])


class Box:
    """Vertices (24, 3), faces (12, 3), uv (24, 2; v up), a picture, and patches (point, normal,
    colour)."""

    def __init__(self) -> None:
        random = np.random.default_rng(3)
        palette = np.stack(np.meshgrid(LEVELS, LEVELS, LEVELS), -1).reshape(-1, 3)
        random.shuffle(palette)
        vertices, faces, uv = [], [], []
        self.picture = np.zeros((2 * CELL, 3 * CELL, 3), np.uint8)
        self.patches: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
        for axis in range(3):
            for row, sign in enumerate((1, -1)):
                normal = sign * np.eye(3)[axis]
                first = np.eye(3)[(axis + 1) % 3]
                second = np.cross(normal, first)
                a, b = first * HALF, second * HALF
                start = len(vertices)
                for s, t in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
                    vertices.append(normal * HALF + s * a + t * b)
                    uv.append(((axis + (s + 1) / 2) / 3, 1 - (row + (1 - t) / 2) / 2))
                faces += [(start, start + 1, start + 2), (start, start + 2, start + 3)]
                for s in (-1, 1):
                    for t in (-1, 1):
                        color = palette[len(self.patches)]
                        x = axis * CELL + (CELL // 2 if s > 0 else 0)
                        y = row * CELL + (CELL // 2 if t < 0 else 0)
                        self.picture[y : y + CELL // 2, x : x + CELL // 2] = color
                        point = normal * HALF + s * a / 2 + t * b / 2
                        self.patches.append((point, normal, color))
        self.vertices, self.faces, self.uv = np.array(vertices), np.array(faces), np.array(uv)

    def quads(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The box as 24 quads, each of one patch's colour: vertices (96, 3), faces, colours."""
        vertices, faces, colors = [], [], []
        for point, normal, color in self.patches:
            axis = int(np.abs(normal).argmax())
            first = np.eye(3)[(axis + 1) % 3]
            a, b = first * HALF / 2, np.cross(normal, first) * HALF / 2
            start = len(vertices)
            vertices += [point - a - b, point + a - b, point + a + b, point - a + b]
            faces += [(start, start + 1, start + 2), (start, start + 2, start + 3)]
            colors += [color] * 4
        return np.array(vertices), np.array(faces), np.array(colors)

    def write_picture(self, path: Path) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        Image.fromarray(self.picture).save(path)

    def png(self, picture: np.ndarray | None = None) -> bytes:
        stream = io.BytesIO()
        Image.fromarray(self.picture if picture is None else picture).save(stream, "PNG")
        return stream.getvalue()

    def obj(self, head: str = "mtllib m.mtl\nusemtl mat\n") -> str:
        rows = ["v {:.6f} {:.6f} {:.6f}".format(*row) for row in self.vertices]
        rows += ["vt {:.6f} {:.6f}".format(*row) for row in self.uv]
        rows += ["f " + " ".join(f"{k + 1}/{k + 1}" for k in face) for face in self.faces]
        return head + "\n".join(rows) + "\n"


BOX = Box()


def shown_right(mesh: Mesh, tolerance: int = 16, views: int = 6) -> tuple[int, int]:
    """How many visible patches have their colour and depth in renderings, and how many there are.

    Where a patch lies in the picture is told by `cv2.projectPoints`.
    """
    renderer, matrix = EmbreeRenderer(), np.array([[500.0, 0, 128], [0, 500.0, 128], [0, 0, 1]])
    turns = Rotation.random(views, random_state=np.random.RandomState(1)).as_matrix()
    right = count = 0
    for turn in turns:
        place = np.array([0.01, -0.02, 0.4])
        pose = Pose(torch.tensor(turn)[None], torch.tensor(place)[None])
        seen = renderer.render([mesh], mesh.inner(pose), torch.tensor(matrix)[None], 256)
        picture = seen.albedo[0].permute(1, 2, 0).numpy() * 255
        depth = seen.depth[0, 0].numpy()
        for point, normal, color in BOX.patches:
            there = turn @ point + place
            if (turn @ normal) @ there / np.linalg.norm(there) > -0.3:
                continue
            pixel = cv2.projectPoints(point[None], cv2.Rodrigues(turn)[0], place, matrix, None)[0]
            x, y = np.rint(pixel.ravel()).astype(int)
            count += 1
            near = abs(depth[y, x] - there[2]) < 0.002
            right += bool(near and np.abs(picture[y, x] - color).max() <= tolerance)
    return right, count


def all_right(mesh: Mesh) -> bool:
    """Whether every visible patch is right."""
    right, count = shown_right(mesh)
    return right == count > 30


class Glb:
    """A GLB put together from arrays; `json` may be changed before it is written."""

    def __init__(self) -> None:
        self.binary = b""
        self.json: dict[str, Any] = {
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0}], "meshes": [{"primitives": [{"attributes": {}}]}],
            "accessors": [], "bufferViews": [],
        }  # fmt: skip

    @property
    def primitive(self) -> dict[str, Any]:
        return self.json["meshes"][0]["primitives"][0]

    def view(self, content: bytes) -> int:
        self.json["bufferViews"].append(
            {"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(content)}
        )
        self.binary += content + b"\0" * (-len(content) % 4)
        return len(self.json["bufferViews"]) - 1

    def accessor(self, values: np.ndarray, normalized: bool = False) -> int:
        codes = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
        kinds = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
        width = 1 if values.ndim == 1 else values.shape[1]
        entry = {"bufferView": self.view(values.tobytes()), "count": len(values),
                 "componentType": codes[values.dtype.str[1:]], "type": kinds[width]}  # fmt: skip
        if normalized:
            entry["normalized"] = True
        self.json["accessors"].append(entry)
        return len(self.json["accessors"]) - 1

    def add(self, name: str, values: np.ndarray, normalized: bool = False) -> None:
        self.primitive["attributes"][name] = self.accessor(values, normalized)

    def write(self, path: Path) -> None:
        self.json["buffers"] = [{"byteLength": len(self.binary)}]
        text = json.dumps(self.json).encode()
        text += b" " * (-len(text) % 4)
        body = struct.pack("<I4s", len(text), b"JSON") + text
        body += struct.pack("<I4s", len(self.binary), b"BIN\0") + self.binary
        path.write_bytes(b"glTF" + struct.pack("<II", 2, 12 + len(body)) + body)


def textured_glb(picture: bytes | None = None, **material: Any) -> Glb:
    """The box with its picture as base colour; `material` replaces entries of the material."""
    glb = Glb()
    glb.add("POSITION", BOX.vertices.astype("<f4"))
    glb.add("TEXCOORD_0", np.stack([BOX.uv[:, 0], 1 - BOX.uv[:, 1]], -1).astype("<f4"))
    glb.primitive.update(indices=glb.accessor(BOX.faces.reshape(-1).astype("<u4")), material=0)
    source = glb.view(picture or BOX.png())
    glb.json["images"] = [{"bufferView": source, "mimeType": "image/png"}]
    glb.json["textures"] = [{"source": 0}]
    base = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}
    glb.json["materials"] = [{"name": "skin", **base, **material}]
    return glb


def colored_glb(colors: np.ndarray, normalized: bool, material: dict[str, Any] | None) -> Glb:
    """The box of 24 quads with COLOR_0."""
    vertices, faces, _ = BOX.quads()
    glb = Glb()
    glb.add("POSITION", vertices.astype("<f4"))
    glb.add("COLOR_0", colors, normalized)
    glb.primitive["indices"] = glb.accessor(faces.reshape(-1).astype("<u4"))
    if material is not None:
        glb.json["materials"] = [material]
        glb.primitive["material"] = 0
    return glb
