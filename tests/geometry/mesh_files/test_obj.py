"""OBJ files as people have them: textured, or refused in one sentence."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from moveit6d.errors import InputError
from moveit6d.geometry.mesh import Mesh
from tests.support.obj_files import write
from tests.support.patches import BOX, all_right


def test_relative_indices_count_back_from_their_own_line(tmp_path: Path) -> None:
    rows = ["mtllib m.mtl", "usemtl mat"]
    for side in range(6):
        corners = range(4 * side, 4 * side + 4)
        rows += ["v {} {} {}".format(*BOX.vertices[k]) for k in corners]
        rows += ["vt {} {}".format(*BOX.uv[k]) for k in corners]
        rows += ["f -4/-4 -3/-3 -2/-2 -1/-1"]
    mesh = Mesh.load(write(tmp_path, obj="\n".join(rows)))
    assert len(np.unique(np.sort(mesh.faces, 1), axis=0)) == 12
    assert all_right(mesh)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("f 1/1", "f 0/1"), "line 5[0-9]: a face names a vertex"),
        (("f 1/1", "f 99/1"), "a face names a vertex"),
        (("f 1/1", "f 1/99"), "a face names a vertex"),
        (("f 1/1", "f x/1"), "not v, v/vt"),
        (("f 1/1", "f 1000000000000000000000/1"), "a face names a vertex"),
        (("v 0.05", "v zero"), "is not a row of numbers"),
        (("v 0.050000", "v nan"), "not finite"),
        (("vt 0.0", "vt 1e38"), "texture coordinates"),
    ],
)
def test_damaged_files_are_refused(tmp_path: Path, change: tuple[str, str], words: str) -> None:
    path = write(tmp_path, obj=BOX.obj().replace(*change, 1))
    with pytest.raises(InputError, match=words):
        Mesh.load(path)
