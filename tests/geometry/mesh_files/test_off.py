"""OFF: colours of vertices and faces."""

from __future__ import annotations

from pathlib import Path

import pytest

from moveit6d.errors import InputError
from moveit6d.geometry.mesh import Mesh
from tests.support.patches import BOX, all_right


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
