"""STL: colours of faces in both ways of writing them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from moveit6d.errors import InputError
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.mesh_files.join import PLAIN
from moveit6d.geometry.mesh_files.stl import RECORD
from tests.support.patches import BOX, all_right


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


def test_a_header_that_counts_too_few_triangles(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    rows = np.zeros(12, RECORD)
    rows["corners"] = BOX.vertices[BOX.faces]

    def load(count: int, content: bytes) -> Mesh:
        path = tmp_path / "box.stl"
        path.write_bytes(b"x" * 80 + np.uint32(count).tobytes() + content)
        return Mesh.load(path)

    for count in (0, 6):
        assert len(load(count, rows.tobytes()).faces) == 12
        assert f"its header counts {count} triangles, but 12 are there" in caplog.text
    caplog.clear()
    # What is no triangle is no part of the object, as before.
    for more in (b"\0", bytes(50), b"\xff" * 50):
        assert len(load(12, rows.tobytes() + more).faces) == 12
    assert not caplog.text


def test_ascii_in_capitals_and_with_any_ends_of_lines(tmp_path: Path) -> None:
    text = "solid Box\n"
    for face in BOX.vertices[BOX.faces].tolist():
        corners = "".join("vertex {:e} {:e} {:e}\n".format(*corner) for corner in face)
        text += f"facet normal 0 0 1\nouter loop\n{corners}endloop\nendfacet\n"
    text += "endsolid Box\n"
    ways = {"low": text, "high": text.upper()}
    ways |= {"mac": text.replace("\n", "\r"), "windows": text.replace("\n", "\r\n")}
    for name, content in ways.items():
        (tmp_path / f"{name}.stl").write_bytes(content.encode())
        mesh = Mesh.load(tmp_path / f"{name}.stl")
        found = (mesh.vertices + mesh.center)[mesh.faces]
        np.testing.assert_allclose(found, BOX.vertices[BOX.faces], atol=1e-6)


@pytest.mark.parametrize("bits", [0, 31])  # a colour whose highest bit is not set does not count
def test_faces_without_a_colour_among_coloured_ones(
    tmp_path: Path, bits: int, caplog: pytest.LogCaptureFixture
) -> None:
    rows = np.zeros(12, RECORD)
    rows["corners"] = BOX.vertices[BOX.faces]
    rows["attribute"] = 1 << 15 | 31 << 10  # red, as VisCAM has it
    rows["attribute"][3] = bits
    path = tmp_path / "box.stl"
    path.write_bytes(b"x" * 80 + np.uint32(12).tobytes() + rows.tobytes())
    mesh = Mesh.load(path)
    colors = np.tile([255, 0, 0], (12, 1))
    colors[3] = PLAIN
    np.testing.assert_array_equal(mesh.vertex_colors[mesh.faces[:, 0]], colors)
    assert "1 of 12 faces have no colour and are shown grey" in caplog.text
    caplog.clear()
    rows["attribute"] = bits
    path.write_bytes(b"x" * 80 + np.uint32(12).tobytes() + rows.tobytes())
    assert (Mesh.load(path).vertex_colors == PLAIN).all()
    assert not caplog.text
    # Magics gives those faces the colour in the header.
    rows["attribute"] = 31
    rows["attribute"][3] = 1 << 15
    head = b"COLOR=\x10\x20\x30\xff".ljust(80, b"\0")
    path.write_bytes(head + np.uint32(12).tobytes() + rows.tobytes())
    mesh = Mesh.load(path)
    colors[3] = (16, 32, 48)
    np.testing.assert_array_equal(mesh.vertex_colors[mesh.faces[:, 0]], colors)
