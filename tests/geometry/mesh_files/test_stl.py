"""STL: colours of faces in both ways of writing them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from moveit6d.errors import InputError
from moveit6d.geometry.mesh import Mesh
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
