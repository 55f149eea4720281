"""Malformed inputs made from a seed: good files of every kind, and what befalls them.

Damage of bytes (flips, cuts, holes, repeats), of text (numbers that are none, far too many digits),
and of JSON (other types, missing and null entries, depth, huge numbers).
"""

from __future__ import annotations

import copy
import io
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from scipy.io import savemat

from tests.support.patches import BOX, colored_glb, textured_glb

NONSENSE: tuple[Any, ...] = (
    None, True, -1, 0, 1e308, 10**400, "", "x", "../../../escaped", [], {}, [[]], [None], {"a": 1},
    "nan", [1e38] * 3, -7.5,
)  # fmt: skip
WORDS = (b"nan", b"inf", b"-1", b"0", b"1e38", b"x", b"", b"99999999999999999999", b"../../x", b"-")


@dataclass(frozen=True)
class Malformed:
    """One input: what it is, and the folder's files by name; `reader` names who reads it."""

    name: str
    reader: str
    files: dict[str, bytes]


def corpus(seed: int, count: int) -> Iterator[Malformed]:
    """`count` inputs, the same for the same seed, of all kinds in turn."""
    random = np.random.default_rng(seed)
    kinds = list(good_files())
    for number in range(count):
        name, reader, files, victims = kinds[number % len(kinds)]
        victim = victims[int(random.integers(len(victims)))]
        changed = dict(files)
        damage, label = _damage(victim, random)
        changed[victim] = damage(files[victim])
        yield Malformed(f"{number:04d} {name} {victim} {label}", reader, changed)


def good_files() -> Iterator[tuple[str, str, dict[str, bytes], list[str]]]:
    """Kind, reader, files of an input that is right, and those of them that are damaged."""
    picture = BOX.png()
    obj = {"box.obj": BOX.obj().encode(), "m.mtl": b"newmtl mat\nKd 1 1 1\nmap_Kd skin.png\n",
           "skin.png": picture}  # fmt: skip
    yield "obj", "mesh", obj, ["box.obj", "m.mtl", "skin.png"]
    yield "glb", "mesh", {"box.glb": _glb(textured_glb())}, ["box.glb"]
    colors = BOX.quads()[2].astype("u1")
    yield "glb", "mesh", {"box.glb": _glb(colored_glb(colors, True, None))}, ["box.glb"]
    yield "gltf", "mesh", {"box.gltf": _gltf()}, ["box.gltf"]
    yield "ply", "mesh", {"box.ply": _ply(), "skin.png": picture}, ["box.ply"]
    yield "ply", "mesh", {"box.ply": _binary_ply()}, ["box.ply"]
    yield "off", "mesh", {"box.off": _off()}, ["box.off"]
    yield "stl", "mesh", {"box.stl": _stl()}, ["box.stl"]
    from tests.support.collada_files import dae

    yield "dae", "mesh", {"box.dae": dae().encode(), "skin.png": picture}, ["box.dae"]
    symmetric = {"symmetries_discrete": [np.diag([-1.0, -1, 1, 1]).reshape(-1).tolist()],
                 "symmetries_continuous": [{"axis": [0, 0, 1], "offset": [0, 0, 0]}]}  # fmt: skip
    beside = {"box.ply": _binary_ply(), "box.symmetry.json": _json(symmetric)}
    yield "symmetry", "mesh", beside, ["box.symmetry.json"]
    camera = {"fx": 200, "fy": 200, "cx": 79.5, "cy": 59.5, "width": 160, "height": 120,
              "distortion": [0.1, 0, 0, 0, 0]}  # fmt: skip
    yield "camera", "camera", {"camera.json": _json(camera)}, ["camera.json"]
    pose = {"rotation": np.eye(3).tolist(), "translation": [0, 0, 0.5]}
    yield "pose", "pose", {"pose.json": _json(pose)}, ["pose.json"]
    yield "csv", "poses", {"poses.csv": _csv()}, ["poses.csv"]
    yield "image", "image", {"a.png": picture}, ["a.png"]
    yield "image", "image", {"a.jpg": _picture("JPEG")}, ["a.jpg"]
    yield "image", "image", {"a.tif": _picture("TIFF")}, ["a.tif"]
    yield "results", "results", {"r.csv": _results()}, ["r.csv"]
    yield "bop", "bop", *_bop()
    yield "laval", "laval", *_laval()
    yield "ycbv", "ycbv", *_ycbv()
    yield "rbot", "rbot", *_rbot()
    yield "folders", "folders", *_folders(camera)
    yield "weights", "weights", {"w.safetensors": _weights()}, ["w.safetensors"]
    yield (
        "pairs",
        "pairs",
        {"pairs.json": _pairs(), "00000-of-00001.safetensors": _weights()},
        ["pairs.json"],
    )


def _damage(victim: str, random: np.random.Generator) -> tuple[Callable[[bytes], bytes], str]:
    """A way to damage a file of that name, and what it is called."""
    ways: list[tuple[Callable[[bytes, np.random.Generator], bytes], str]] = [
        (_flipped, "flip"), (_cut, "cut"), (_hole, "hole"), (_repeated, "repeat"),
    ]  # fmt: skip
    suffix = victim.rsplit(".", 1)[-1]
    if suffix in ("json", "gltf"):
        ways += [(_json_damage, "json")] * 6
    if suffix in ("obj", "mtl", "ply", "off", "dae", "csv", "txt", "json"):
        ways += [(_word, "word")] * 3
    if suffix == "glb":
        ways += [(_glb_damage, "json")] * 4
    if suffix == "npy":
        ways += [(_npy_damage, "array")] * 4
    way, label = ways[int(random.integers(len(ways)))]
    own = np.random.default_rng(random.integers(2**63))
    return lambda content: way(content, own), label


def _flipped(content: bytes, random: np.random.Generator) -> bytes:
    changed = bytearray(content)
    for place in random.integers(0, max(len(changed), 1), int(random.integers(1, 12))):
        if len(changed):
            changed[place] ^= 1 << int(random.integers(8))
    return bytes(changed)


def _cut(content: bytes, random: np.random.Generator) -> bytes:
    return content[: int(len(content) * random.random())]


def _hole(content: bytes, random: np.random.Generator) -> bytes:
    start = int(random.integers(0, max(len(content), 1)))
    length = int(random.integers(1, 64))
    filler = bytes([int(random.choice([0, 255, 32, 45]))]) * length
    return content[:start] + filler + content[start + length :]


def _repeated(content: bytes, random: np.random.Generator) -> bytes:
    start, end = sorted(random.integers(0, len(content) + 1, 2).tolist())
    return content[:end] + content[start:end] * int(random.integers(1, 4)) + content[end:]


def _word(content: bytes, random: np.random.Generator) -> bytes:
    words = content.split(b" ")
    for place in random.integers(0, len(words), int(random.integers(1, 4))):
        words[place] = WORDS[int(random.integers(len(WORDS)))]
    return b" ".join(words)


def _json_damage(content: bytes, random: np.random.Generator) -> bytes:
    if random.random() < 0.05:
        return b"[" * 100_000
    data = copy.deepcopy(json.loads(content))
    places = list(_places(data))
    for _ in range(int(random.integers(1, 3))):
        holder, key = places[int(random.integers(len(places)))]
        if random.random() < 0.25 and isinstance(holder, dict):
            holder.pop(key, None)
        elif not isinstance(holder, list) or key < len(holder):
            holder[key] = copy.deepcopy(NONSENSE[int(random.integers(len(NONSENSE)))])
    return json.dumps(data).encode()


def _places(data: Any) -> Iterator[tuple[Any, Any]]:
    items = data.items() if isinstance(data, dict) else enumerate(data)
    for key, value in list(items):
        yield data, key
        if isinstance(value, dict | list):
            yield from _places(value)


def _glb_damage(content: bytes, random: np.random.Generator) -> bytes:
    size = int.from_bytes(content[12:16], "little")
    text = _json_damage(content[20 : 20 + size], random)
    text += b" " * (-len(text) % 4)
    body = len(text).to_bytes(4, "little") + b"JSON" + text + content[20 + size :]
    return content[:8] + (12 + len(body)).to_bytes(4, "little") + body


def _npy_damage(content: bytes, random: np.random.Generator) -> bytes:
    shapes: list[Any] = [(3, 15), (0, 16), (2, 4, 4, 2), (16,), ()]
    arrays = [np.ones(shape) for shape in shapes]
    arrays += [np.full((3, 16), np.nan), np.array([["a"] * 16]), np.zeros((2, 16), complex)]
    stream = io.BytesIO()
    np.save(stream, arrays[int(random.integers(len(arrays)))])
    return stream.getvalue()


def _json(content: Any) -> bytes:
    return json.dumps(content).encode()


def _glb(glb: Any) -> bytes:
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        glb.write(Path(folder) / "a.glb")
        return (Path(folder) / "a.glb").read_bytes()


def _gltf() -> bytes:
    import base64

    glb = textured_glb()
    uri = "data:application/octet-stream;base64," + base64.b64encode(glb.binary).decode()
    glb.json["buffers"] = [{"byteLength": len(glb.binary), "uri": uri}]
    return json.dumps(glb.json).encode()


def _ply() -> bytes:
    from tests.support.ply_files import textured_ply

    return textured_ply().encode()


def _binary_ply(scale: float = 1.0) -> bytes:
    vertices, faces, colors = BOX.quads()
    head = "ply\nformat binary_little_endian 1.0\nelement vertex 96\n"
    head += "".join(f"property float {name}\n" for name in "xyz")
    head += "".join(f"property uchar {name}\n" for name in ("red", "green", "blue"))
    head += "element face 48\nproperty list uchar int vertex_indices\nend_header\n"
    table = np.empty(96, [("p", "<f4", 3), ("c", "u1", 3)])
    table["p"], table["c"] = vertices * scale, colors
    lists = np.empty(48, [("n", "u1"), ("i", "<i4", 3)])
    lists["n"], lists["i"] = 3, faces
    return head.encode() + table.tobytes() + lists.tobytes()


def _obj_in_millimetres() -> bytes:
    rows = ["v {:.3f} {:.3f} {:.3f}".format(*row) for row in 1000 * BOX.vertices]
    return "\n".join(rows + ["f {} {} {}".format(*face) for face in BOX.faces + 1]).encode()


def _off() -> bytes:
    vertices, faces, colors = BOX.quads()
    rows = ["COFF", "96 48 0"]
    rows += ["{} {} {} ".format(*v) + "{} {} {} 255".format(*c)
             for v, c in zip(vertices, colors, strict=True)]  # fmt: skip
    return "\n".join(rows + ["3 {} {} {}".format(*face) for face in faces]).encode()


def _stl() -> bytes:
    rows = np.zeros(12, [("n", "<f4", 3), ("p", "<f4", (3, 3)), ("a", "<u2")])
    rows["p"] = BOX.vertices[BOX.faces]
    return bytes(80) + np.uint32(12).tobytes() + rows.tobytes()


def _csv() -> bytes:
    head = "frame,image,r11,r12,r13,r21,r22,r23,r31,r32,r33,tx,ty,tz,steps,stopped_by,confidence"
    rows = [f"{k},{k}.png,1,0,0,0,1,0,0,0,1,0,0,0.5,3,stop_action,0.9" for k in range(3)]
    return "\n".join([head, *rows, ""]).encode()


def _results() -> bytes:
    rows = [f"1,{k},1,0.9,1 0 0 0 1 0 0 0 1,0 0 400,0.1" for k in range(3)]
    return "\n".join(["scene_id,im_id,obj_id,score,R,t,time", *rows, ""]).encode()


def _picture(kind: str) -> bytes:
    stream = io.BytesIO()
    Image.fromarray(BOX.picture).save(stream, kind)
    return stream.getvalue()


def _bop() -> tuple[dict[str, bytes], list[str]]:
    truth = {"obj_id": 1, "cam_R_m2c": [1, 0, 0, 0, 1, 0, 0, 0, 1], "cam_t_m2c": [0, 0, 400]}
    files = {
        "models/models_info.json": _json({"1": {"diameter": 141.4, "symmetries_discrete": []}}),
        "models/obj_000001.ply": _binary_ply(1000),
        "test/000001/scene_camera.json": _json(
            {"0": {"cam_K": [200, 0, 48, 0, 200, 32, 0, 0, 1], "depth_scale": 1.0}}
        ),
        "test/000001/scene_gt.json": _json({"0": [truth]}),
        "test/000001/scene_gt_info.json": _json({"0": [{"visib_fract": 0.9}]}),
        "test/000001/rgb/000000.png": BOX.png(),
        "test_targets_bop19.json": _json(
            [{"scene_id": 1, "im_id": 0, "obj_id": 1, "inst_count": 1}]
        ),
    }
    return files, [name for name in files if name.endswith("json")]


def _laval() -> tuple[dict[str, bytes], list[str]]:
    matrix = np.diag([1.0, 1, 1, 1])
    matrix[2, 3] = -0.5
    stream = io.BytesIO()
    np.save(stream, np.stack([matrix.reshape(-1)] * 2))
    camera = {"focalX": 200, "focalY": 200, "centerX": 48, "centerY": 32, "width": 96, "height": 64,
              "distortion": [0, 0, 0, 0, 0]}  # fmt: skip
    files = {"dog/geometry.ply": _binary_ply(), "dog_occlusion_0/0.png": BOX.png(),
             "dog_occlusion_0/1.png": BOX.png(), "dog_occlusion_0/camera.json": _json(camera),
             "dog_occlusion_0/poses.npy": stream.getvalue()}  # fmt: skip
    return files, ["dog_occlusion_0/camera.json", "dog_occlusion_0/poses.npy"]


def _ycbv() -> tuple[dict[str, bytes], list[str]]:
    stream = io.BytesIO()
    pose = np.concatenate([np.eye(3), [[0], [0], [0.5]]], 1)[..., None]
    intrinsics = np.diag([200.0, 200, 1])
    savemat(stream, {"cls_indexes": np.array([[1]], np.uint8), "poses": pose,
                     "intrinsic_matrix": intrinsics}, do_compression=True)  # fmt: skip
    files = {"data/0048/000001-color.png": BOX.png(),
             "data/0048/000001-meta.mat": stream.getvalue(),
             "keyframe.txt": b"0048/000001\n", "image_sets/classes.txt": b"box\n",
             "models/box/textured_simple.obj": BOX.obj("").encode()}  # fmt: skip
    return files, ["data/0048/000001-meta.mat", "data/0048/000001-color.png", "keyframe.txt",
                   "image_sets/classes.txt"]  # fmt: skip


def _rbot() -> tuple[dict[str, bytes], list[str]]:
    files = {"camera_calibration.txt": b"fx fy cx cy\n200 200 48 32\n",
             "poses_first.txt": b"head\n" + b"1 0 0 0 1 0 0 0 1 0 0 500\n" * 2,
             "cat/cat.obj": _obj_in_millimetres(), "cat/frames/a_regular0000.png": BOX.png(),
             "cat/frames/a_regular0001.png": BOX.png()}  # fmt: skip
    return files, ["camera_calibration.txt", "poses_first.txt", "cat/frames/a_regular0000.png"]


def _folders(camera: dict[str, Any]) -> tuple[dict[str, bytes], list[str]]:
    files = {"camera.json": _json(camera), "poses.csv": _csv(),
             "mesh.ply": _binary_ply(), "frames/0.png": BOX.png(), "frames/1.png": BOX.png(),
             "frames/2.png": BOX.png()}  # fmt: skip
    return files, ["camera.json", "poses.csv", "frames/0.png"]


def _weights() -> bytes:
    import dataclasses

    from safetensors.numpy import save

    from moveit6d.networks.correlation import CorrelationConfig

    config = json.dumps(dataclasses.asdict(CorrelationConfig()))
    header = {"format": "moveit6d-1", "kind": "correlation", "config": config}
    return save({"a": np.zeros(3, np.float32)}, header)


def _pairs() -> bytes:
    return _json({"format": "moveit6d-pairs-3", "shards": 1, "batches": 1, "batch_size": 2,
                  "seed": 0, "source": "0"})  # fmt: skip
