"""PLY, OFF, STL and Collada: colours, pictures and shapes, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from moveit6d.errors import InputError
from moveit6d.geometry.mesh import Mesh
from tests.support.patches import BOX, all_right

# PLY


def ply(head: list[str], rows: list[str], form: str = "ascii") -> str:
    return "\n".join(["ply", f"format {form} 1.0", *head, "end_header", *rows]) + "\n"


def textured_ply(names: tuple[str, str] = ("s", "t"), comment: str = "skin.png") -> str:
    head = [f"comment TextureFile {comment}", "element vertex 24"]
    head += [f"property float {name}" for name in ("x", "y", "z", *names)]
    head += ["element face 12", "property list uchar int vertex_indices"]
    rows = [" ".join(map(str, row)) for row in np.concatenate([BOX.vertices, BOX.uv], 1).tolist()]
    return ply(head, rows + ["3 {} {} {}".format(*face) for face in BOX.faces.tolist()])


@pytest.mark.parametrize("names", [("s", "t"), ("u", "v"), ("texture_u", "texture_v")])
@pytest.mark.parametrize("comment", ["skin.png", "SKIN.png", "C:\\x\\skin.png", '"skin.png"'])
def test_ply_textures(tmp_path: Path, names: tuple[str, str], comment: str) -> None:
    BOX.write_picture(tmp_path / "skin.png")
    (tmp_path / "box.ply").write_text(textured_ply(names, comment))
    assert all_right(Mesh.load(tmp_path / "box.ply"))


def test_ply_without_its_texture_is_refused(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "box.ply").write_text(textured_ply())
    with pytest.raises(InputError, match=r"'skin.png' \(comment TextureFile\) is not there"):
        Mesh.load(tmp_path / "box.ply")
    assert Mesh.load(tmp_path / "box.ply", allow_untextured=True).texture is None
    assert "skin.png" in caplog.text


@pytest.mark.parametrize("prefix", ["", "diffuse_"])
@pytest.mark.parametrize("form", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_ply_vertex_colours(tmp_path: Path, prefix: str, form: str) -> None:
    vertices, faces, colors = BOX.quads()
    order = ">" if form.endswith("big_endian") else "<"
    head = ["element vertex 96"] + [f"property float {name}" for name in "xyz"]
    head += [f"property uchar {prefix}{name}" for name in ("red", "green", "blue")]
    head += ["element face 48", "property list uchar int vertex_indices"]
    if form == "ascii":
        rows = ["{} {} {} ".format(*v) + "{} {} {}".format(*c)
                for v, c in zip(vertices, colors, strict=True)]  # fmt: skip
        rows += ["3 {} {} {}".format(*face) for face in faces]
        (tmp_path / "box.ply").write_text(ply(head, rows))
    else:
        table = np.empty(96, [("p", order + "f4", 3), ("c", "u1", 3)])
        table["p"], table["c"] = vertices, colors
        lists = np.empty(48, [("n", "u1"), ("i", order + "i4", 3)])
        lists["n"], lists["i"] = 3, faces
        body = table.tobytes() + lists.tobytes()
        (tmp_path / "box.ply").write_bytes(ply(head, [], form).rstrip("\n").encode() + b"\n" + body)
    assert all_right(Mesh.load(tmp_path / "box.ply"))


def test_ply_colours_of_faces_that_are_quads_and_triangles(tmp_path: Path) -> None:
    vertices, faces, colors = BOX.quads()
    head = ["element vertex 96"] + [f"property double {name}" for name in "xyz"]
    head += ["element face 25", "property list uchar uint vertex_index"]
    head += [f"property float {name}" for name in ("red", "green", "blue")]
    rows = ["{} {} {}".format(*row) for row in vertices]
    tints = ["{} {} {}".format(*(row / 255)) for row in colors[::4]]
    rows += [f"4 {4 * k} {4 * k + 1} {4 * k + 2} {4 * k + 3} {tints[k]}" for k in range(23)]
    rows += [f"3 {92 + a} {92 + b} {92 + c} {tints[23]}" for a, b, c in ((0, 1, 2), (0, 2, 3))]
    (tmp_path / "box.ply").write_text(ply(head, rows))
    assert all_right(Mesh.load(tmp_path / "box.ply"))


def test_ply_two_textures_by_face(tmp_path: Path) -> None:
    BOX.write_picture(tmp_path / "a.png")
    BOX.write_picture(tmp_path / "b.png")
    head = ["comment TextureFile a.png", "comment TextureFile b.png", "element vertex 24"]
    head += [f"property float {name}" for name in "xyz"]
    head += ["element face 12", "property list uchar int vertex_indices"]
    head += ["property list uchar float texcoord", "property int texnumber"]
    rows = ["{} {} {}".format(*row) for row in BOX.vertices]
    for k, face in enumerate(BOX.faces):
        uv = " ".join(map(str, BOX.uv[face].reshape(-1).tolist()))
        rows.append("3 {} {} {} 6 ".format(*face) + f"{uv} {k % 2}")
    (tmp_path / "box.ply").write_text(ply(head, rows))
    assert all_right(Mesh.load(tmp_path / "box.ply"))


@pytest.mark.parametrize("keep", [0.97, 0.7, 0.3])
def test_a_ply_that_was_cut_off_is_refused(tmp_path: Path, keep: float) -> None:
    BOX.write_picture(tmp_path / "skin.png")
    text = textured_ply()
    (tmp_path / "box.ply").write_text(text[: int(keep * len(text))].rsplit("\n", 1)[0])
    with pytest.raises(InputError, match=r"cut off or damaged"):
        Mesh.load(tmp_path / "box.ply")


# OFF and STL


def test_coff_and_colours_of_faces(tmp_path: Path) -> None:
    vertices, faces, colors = BOX.quads()
    rows = ["COFF", "# made", "96 48 0"]
    rows += ["{} {} {} ".format(*v) + "{} {} {} 255".format(*c)
             for v, c in zip(vertices, colors, strict=True)]  # fmt: skip
    rows += ["3 {} {} {}".format(*face) for face in faces]
    (tmp_path / "a.off").write_text("\n".join(rows))
    assert all_right(Mesh.load(tmp_path / "a.off"))
    rows = ["OFF 96 24 0"] + ["{} {} {}".format(*v) for v in vertices]
    rows += [f"4 {4 * k} {4 * k + 1} {4 * k + 2} {4 * k + 3} " + "{} {} {}".format(*colors[4 * k])
             for k in range(24)]  # fmt: skip
    (tmp_path / "b.off").write_text("\n".join(rows))
    assert all_right(Mesh.load(tmp_path / "b.off"))
    (tmp_path / "b.off").write_text("\n".join(rows[:-3]))
    with pytest.raises(InputError, match="cut off"):
        Mesh.load(tmp_path / "b.off")


@pytest.mark.parametrize("head", [b"made by VisCAM", b"COLOR=\xff\xff\xff\xff made by Magics"])
def test_stl_face_colours(tmp_path: Path, head: bytes) -> None:
    vertices, faces, colors = BOX.quads()
    rows = np.zeros(48, [("n", "<f4", 3), ("p", "<f4", (3, 3)), ("a", "<u2")])
    rows["p"] = vertices[faces]
    five = np.rint(colors[faces[:, 0]] / 255 * 31).astype(np.uint16)
    if head.startswith(b"COLOR"):
        rows["a"] = five[:, 0] | five[:, 1] << 5 | five[:, 2] << 10
    else:
        rows["a"] = five[:, 2] | five[:, 1] << 5 | five[:, 0] << 10 | 1 << 15
    content = head.ljust(80, b"\0") + np.uint32(48).tobytes() + rows.tobytes()
    (tmp_path / "box.stl").write_bytes(content)
    assert all_right(Mesh.load(tmp_path / "box.stl"))
    (tmp_path / "box.stl").write_bytes(content[:-20])
    with pytest.raises(InputError, match="cut off"):
        Mesh.load(tmp_path / "box.stl")


# Collada

DAE = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="centimeter" meter="0.01"/><up_axis>Z_UP</up_axis></asset>
<library_images><image id="i"><init_from>{picture}</init_from></image></library_images>
<library_effects><effect id="e"><profile_COMMON>
<newparam sid="f"><surface type="2D"><init_from>i</init_from></surface></newparam>
<newparam sid="s"><sampler2D><source>f</source></sampler2D></newparam>
<technique sid="c"><lambert><diffuse>{diffuse}</diffuse></lambert></technique>
</profile_COMMON></effect></library_effects>
<library_materials><material id="m" name="skin"><instance_effect url="#e"/></material>
</library_materials>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="pa" count="72">{points}</float_array><technique_common>
<accessor source="#pa" count="24" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<source id="t"><float_array id="ta" count="48">{uv}</float_array><technique_common>
<accessor source="#ta" count="24" stride="2"><param name="S" type="float"/>
<param name="T" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<{kind} count="{count}" material="a"><input semantic="VERTEX" source="#v" offset="0"/>
<input semantic="TEXCOORD" source="#t" offset="1" set="0"/>{vcount}<p>{index}</p></{kind}>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="w"><node><translate>1 2 3</translate><node>
<instance_geometry url="#g"><bind_material><technique_common>
<instance_material symbol="a" target="#m"><bind_vertex_input_set semantic="uv"
 input_semantic="TEXCOORD" input_set="0"/></instance_material>
</technique_common></bind_material></instance_geometry></node></node></visual_scene>
</library_visual_scenes><scene><instance_visual_scene url="#w"/></scene></COLLADA>"""


def dae(kind: str = "triangles", picture: str = "skin.png", shown: bool = True) -> str:
    quads = [[4 * k, 4 * k + 1, 4 * k + 2, 4 * k + 3] for k in range(6)]
    rows = BOX.faces.tolist() if kind == "triangles" else quads
    return DAE.format(
        picture=picture,
        diffuse='<texture texture="s" texcoord="uv"/>' if shown else "<color>1 0 0 1</color>",
        points=" ".join(map(str, (BOX.vertices * 100 - (1, 2, 3)).reshape(-1).tolist())),
        uv=" ".join(map(str, BOX.uv.reshape(-1).tolist())),
        kind=kind,
        count=len(rows),
        vcount="" if kind == "triangles" else f"<vcount>{'4 ' * 6}</vcount>",
        index=" ".join(f"{k} {k}" for row in rows for k in row),
    )


def one_coloured(color: str) -> str:
    """A PLY of which every vertex says the same colour."""
    channels = [f"property uchar {name}" for name in ("red", "green", "blue")]
    axes = [f"property float {name}" for name in "xyz"]
    count = len(BOX.vertices)
    head = [f"element vertex {count}", *axes, *channels, f"element face {len(BOX.faces)}"]
    rows = ["{} {} {} ".format(*point) + color for point in BOX.vertices.tolist()]
    faces = ["3 {} {} {}".format(*face) for face in BOX.faces.tolist()]
    return ply([*head, "property list uchar int vertex_indices"], rows + faces)


def test_one_colour_that_every_vertex_says_is_meant_but_grey_is_none(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "red.ply").write_text(one_coloured("190 12 10"))
    mesh = Mesh.load(tmp_path / "red.ply", "m")
    assert mesh.vertex_colors is not None
    np.testing.assert_array_equal(mesh.vertex_colors[0], (190, 12, 10))
    assert "one colour" in caplog.text
    for lost in ("255 255 255", "128 128 128"):
        (tmp_path / "grey.ply").write_text(one_coloured(lost))
        with pytest.raises(InputError, match="one colour"):
            Mesh.load(tmp_path / "grey.ply", "m")


@pytest.mark.parametrize("kind", ["triangles", "polylist"])
@pytest.mark.parametrize("picture", ["skin.png", "file:///C:/x/SKIN.png", "./skin.png"])
def test_collada_with_a_picture(tmp_path: Path, kind: str, picture: str) -> None:
    BOX.write_picture(tmp_path / "skin.png")
    (tmp_path / "box.dae").write_text(dae(kind, picture))
    mesh = Mesh.load(tmp_path / "box.dae", "cm")
    assert len(mesh.faces) == 12
    assert all_right(mesh)


def test_collada_whose_picture_is_lost(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "box.dae").write_text(dae())
    with pytest.raises(InputError, match=r"material 'skin'.*'skin.png'.*not there"):
        Mesh.load(tmp_path / "box.dae", "cm")
    (tmp_path / "box.dae").write_text(dae(shown=False))
    with pytest.raises(InputError, match=r"one colour, RGB \(255, 0, 0\)"):
        Mesh.load(tmp_path / "box.dae", "cm")
    mesh = Mesh.load(tmp_path / "box.dae", "cm", allow_untextured=True)
    np.testing.assert_array_equal(mesh.vertex_colors[0], (255, 0, 0))
    assert "one colour" in caplog.text


@pytest.mark.parametrize(
    "content", ["", "<COLLADA/>", "<a", "<!DOCTYPE a [<!ENTITY b 'c'>]><COLLADA/>"]
)
def test_collada_that_is_damaged(tmp_path: Path, content: str) -> None:
    (tmp_path / "box.dae").write_text(content)
    with pytest.raises(InputError, match=r"box\.dae"):
        Mesh.load(tmp_path / "box.dae")


def test_a_folder_or_a_pipe_is_no_mesh(tmp_path: Path) -> None:
    import os

    (tmp_path / "a.obj").mkdir()
    os.mkfifo(tmp_path / "b.ply")
    for name in ("a.obj", "b.ply"):
        with pytest.raises(InputError, match="not a regular file"):
            Mesh.load(tmp_path / name)


def test_pictures_that_promise_more_than_they_hold(tmp_path: Path) -> None:
    import struct
    import zlib

    def chunk(kind: bytes, content: bytes) -> bytes:
        check = struct.pack(">I", zlib.crc32(kind + content))
        return struct.pack(">I", len(content)) + kind + content + check

    size = 30_000
    rows = zlib.compress(bytes((size // 8 + 1) * size // 8))
    picture = b"\x89PNG\r\n\x1a\n" + chunk(
        b"IHDR", struct.pack(">IIBBBBB", size, size, 1, 0, 0, 0, 0)
    )
    (tmp_path / "skin.png").write_bytes(picture + chunk(b"IDAT", rows) + chunk(b"IEND", b""))
    (tmp_path / "box.ply").write_text(textured_ply())
    with pytest.raises(InputError, match=r"30000×30000|readable picture"):
        Mesh.load(tmp_path / "box.ply")
