"""Files that are unusual and yet right, and mistakes that people make: right, or one sentence."""

from __future__ import annotations

import io
import json
import os
import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import Image

from moveit6d.datasets.pose_files import read_poses
from moveit6d.datasets.video import open_frames, read_image
from moveit6d.errors import InputError
from moveit6d.estimation.detection.points import poses_from_points, read_points
from moveit6d.geometry.camera import Camera
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.mesh_files import pictures
from moveit6d.geometry.pose import Pose
from tests.support.malformed import good_files
from tests.support.patches import BOX, all_right, textured_glb

OBJ = BOX.obj()
CAMERA = {"fx": 200, "fy": 200, "cx": 79.5, "cy": 59.5, "width": 160, "height": 120}
CSV = next(files["poses.csv"] for name, _, files, _ in good_files() if name == "csv")


def write_box(folder: Path, text: str | bytes, name: str = "box.obj") -> Path:
    """The box as OBJ, its library and its picture."""
    folder.mkdir(exist_ok=True)
    (folder / name).write_bytes(text if isinstance(text, bytes) else text.encode())
    (folder / "m.mtl").write_text("newmtl mat\nmap_Kd skin.png\n")
    BOX.write_picture(folder / "skin.png")
    return folder / name


def with_more(text: str, more: str, *heads: str) -> str:
    """The lines that begin with one of `heads` with `more` at their end."""
    return "\n".join(line + more if line.startswith(heads) else line for line in text.splitlines())


@pytest.mark.parametrize(
    "text",
    [
        OBJ.replace("\n", "\r"),
        OBJ.replace("\n", "\r\n").replace(" ", "\t"),
        OBJ.replace("f ", "f \\\n"),
        with_more(OBJ, " # 1 2 3", "v ", "vt ", "f "),
        with_more(OBJ, " 1.0", "v ", "vt "),
        "\n".join(sorted(OBJ.splitlines(), key=lambda line: "mufv".index(line[0]))),
        OBJ.encode("utf-16"),
    ],
    ids=["CR", "CRLF, tabs", "continued", "comments", "w", "faces first", "UTF-16"],
)
def test_an_obj_is_read_however_it_is_written(tmp_path: Path, text: str | bytes) -> None:
    assert all_right(Mesh.load(write_box(tmp_path, text), "m"))


@pytest.mark.parametrize("name", ["größe 1 (neu)/mein box #1.obj", "箱 📦/模型.OBJ"])
def test_names_with_blanks_and_other_letters(tmp_path: Path, name: str) -> None:
    assert all_right(Mesh.load(write_box(tmp_path / name.split("/")[0], OBJ, name.split("/")[1])))


def test_a_link_to_a_mesh_finds_what_lies_beside_the_mesh(tmp_path: Path) -> None:
    mesh = write_box(tmp_path / "store", OBJ)
    turn = {"symmetries_discrete": [np.diag([-1.0, -1, 1, 1]).reshape(-1).tolist()]}
    (tmp_path / "store" / "box.symmetry.json").write_text(json.dumps(turn))
    os.symlink(mesh, tmp_path / "mine.obj")
    linked = Mesh.load(tmp_path / "mine.obj")
    assert all_right(linked) and len(linked.symmetries.discrete) == len(
        Mesh.load(mesh).symmetries.discrete
    )
    (tmp_path / "a.obj").symlink_to(tmp_path / "b.obj")
    (tmp_path / "b.obj").symlink_to(tmp_path / "a.obj")
    with pytest.raises(InputError, match="no such mesh file"):
        Mesh.load(tmp_path / "a.obj")


def interlaced(pixels: np.ndarray) -> bytes:
    """A PNG by Adam7, which Pillow reads but does not write."""
    height, width = pixels.shape[:2]
    rows = b""
    for x, y, right, down in (
        (0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2),
        (0, 1, 1, 2),
    ):  # fmt: skip
        rows += b"".join(b"\0" + row.tobytes() for row in pixels[y::down, x::right])

    def chunk(kind: bytes, content: bytes) -> bytes:
        check = struct.pack(">I", zlib.crc32(kind + content))
        return struct.pack(">I", len(content)) + kind + content + check

    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 1)
    body = chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + body


def saved(kind: str, mode: str = "RGB", **options: Any) -> bytes:
    stream, image = io.BytesIO(), Image.fromarray(BOX.picture)
    (image.quantize(64) if mode == "P" else image.convert(mode)).save(stream, kind, **options)
    return stream.getvalue()


def exif(orientation: int) -> Image.Exif:
    tags = Image.Exif()
    tags[0x0112] = orientation
    return tags


BEST = {"quality": 98, "subsampling": 0}
PICTURES: dict[str, Callable[[], bytes]] = {
    "palette": lambda: saved("PNG", "P"),
    "palette with a transparent colour": lambda: saved("PNG", "P", transparency=3),
    "CMYK": lambda: saved("JPEG", "CMYK", **BEST),
    "progressive": lambda: saved("JPEG", progressive=True, **BEST),
    "interlaced": lambda: interlaced(BOX.picture),
    "16 bits": lambda: cv2.imencode(".png", BOX.picture[..., ::-1].astype(np.uint16) * 257)[
        1
    ].tobytes(),
    "Lab": lambda: saved("TIFF", "LAB"),
}


@pytest.mark.parametrize("kind", [*PICTURES])
def test_pictures_of_every_kind(tmp_path: Path, kind: str) -> None:
    content = PICTURES[kind]()
    if kind != "Lab":  # which glTF does not know
        textured_glb(content).write(tmp_path / "box.glb")
        assert all_right(Mesh.load(tmp_path / "box.glb"))
    (tmp_path / "a.png").write_bytes(content)
    assert np.abs(read_image(tmp_path / "a.png").astype(int) - BOX.picture).mean() < 4


def test_a_camera_turns_pictures_but_no_textures(tmp_path: Path) -> None:
    content = saved("JPEG", exif=exif(6), **BEST)
    (tmp_path / "a.jpg").write_bytes(content)
    assert read_image(tmp_path / "a.jpg").shape == (96, 64, 3)
    textured_glb(content).write(tmp_path / "box.glb")
    assert all_right(Mesh.load(tmp_path / "box.glb")), "glTF has orientations ignored"


def test_textures_of_any_size(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 1000)  # instead of 16k pictures
    assert pictures.decode_picture(saved("PNG"), "it").size == (96, 64)
    assert Image.MAX_IMAGE_PIXELS == 1000
    monkeypatch.setattr(pictures, "MOST_PIXELS", 1000)
    with pytest.raises(InputError, match="it has 96×64 pixels; reduce it"):
        pictures.decode_picture(saved("PNG"), "it")
    monkeypatch.undo()
    monkeypatch.setattr(pictures, "MAX_TEXTURE", 16)
    small = pictures.decode_picture(saved("PNG"), "it")
    assert small.pixels.shape == (11, 16, 3) and small.size == (96, 64)
    assert np.abs(small.pixels.mean((0, 1)) - BOX.picture.mean((0, 1))).max() < 4


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-be"])
def test_text_of_other_programs(tmp_path: Path, encoding: str) -> None:
    mark = "\ufeff" if encoding == "utf-16-be" else ""
    (tmp_path / "c.json").write_bytes((mark + json.dumps(CAMERA)).encode(encoding))
    assert Camera.load(tmp_path / "c.json").fx == 200
    table = (mark + CSV.decode()).replace(",", ", ").replace("\n", "\r\n")
    (tmp_path / "p.csv").write_bytes(table.encode(encoding))
    assert [row.frame for row in read_poses(tmp_path / "p.csv")] == [0, 1, 2]
    pose = {"rotation": np.eye(3).tolist(), "translation": [[0], [0], [0.5]]}
    (tmp_path / "p.json").write_bytes((mark + json.dumps(pose)).encode(encoding))
    assert Pose.load(tmp_path / "p.json").translation.tolist() == [0, 0, 0.5]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"fx": 1.1, "fy": 1.4, "cx": 0.5, "cy": 0.5}, "shares of the picture's size"),
        ({"width": "160"}, "width must be a number, found '160'"),
        ({"width": 160.5}, "must be a whole number"),
        ({"fx": -200}, "must be positive"),
    ],
)
def test_cameras_that_cannot_be_right(tmp_path: Path, change: dict[str, Any], words: str) -> None:
    (tmp_path / "c.json").write_text(json.dumps({**CAMERA, **change}))
    with pytest.raises(InputError, match=words):
        Camera.load(tmp_path / "c.json")


TURN = np.eye(3).tolist()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ({"rotation": np.diag([1, 1, -1]).tolist(), "translation": [0, 0, 0.5]}, "left-handed"),
        ({"rotation": [0, 0, 0, 1], "translation": [0, 0, 0.5]}, "must be 3×3"),
        ({"quaternion": [0, 0, 0, 1], "translation": [0, 0, 0.5]}, "rotation missing"),
        (CAMERA, "rotation and translation missing"),
        ([1, 2], "a pose file holds"),
    ],
)
def test_poses_of_other_conventions(tmp_path: Path, content: Any, words: str) -> None:
    (tmp_path / "p.json").write_text(json.dumps(content))
    with pytest.raises(InputError, match=words):
        Pose.load(tmp_path / "p.json")


POINTS = "\n".join(
    f"{u},{v},{x},{y},{z}"
    for u, v, x, y, z in (
        (298.4, 102.5, 18.9, 0, 7.5), (562.5, 184.4, 18.9, 25.8, 7.5), (594.7, 68.9, 0, 25.8, 7.5),
        (298.7, 163.9, 18.9, 0, 0), (539.7, 240.4, 18.9, 25.8, 0),
    )
)  # fmt: skip


@pytest.mark.parametrize("head", ["", "u,v,x,y,z\n", "\ufeff", "\ufeffu,v,x,y,z\n"])
def test_no_point_is_lost(tmp_path: Path, head: str) -> None:
    (tmp_path / "points.csv").write_text(f"{head}{POINTS}\n\n", encoding="utf-8")
    points = read_points(tmp_path / "points.csv", "cm")
    assert points.shape == (5, 5)
    (tmp_path / "excel.csv").write_text(POINTS.replace(",", ";"))
    assert np.array_equal(read_points(tmp_path / "excel.csv", "cm"), points)
    assert float(poses_from_points(points, Camera.from_fov(60, 640, 480))[0].translation[2]) > 0.5


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (POINTS.replace("18.9", "nan"), "line 1: five numbers"),
        (POINTS.replace(",", " "), "its heading is"),
        ("\n".join(POINTS.split("\n")[:3]), "at least 4 rows"),
        ("1,1,1,0,0\n2,2,2,0,0\n3,3,3,0,0\n4,4,4,0,0", "not all of them lie on one line"),
        (POINTS.replace("298.4,102.5", "98.4,402.5"), "check their order"),
    ],
)
def test_points_that_say_nothing(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "points.csv").write_text(text)
    with pytest.raises(InputError, match=words):
        poses_from_points(read_points(tmp_path / "points.csv", "cm"), Camera.from_fov(60, 640, 480))


def test_places_of_videos_that_people_try(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a b").mkdir()
    BOX.write_picture(tmp_path / "a b" / "1.png")
    address = (tmp_path / "a b").as_uri()
    assert "%20" in address and len(list(open_frames(address))) == 1
    with pytest.raises(InputError, match="camera 987 cannot be opened"):
        open_frames("/dev/video987")
    for place in ("-", "x" * 5000, "a\0b", str(tmp_path / "*.png")):
        with pytest.raises(InputError, match="does not exist: give a folder"):
            open_frames(place)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match="holds no images"):
        open_frames("")
