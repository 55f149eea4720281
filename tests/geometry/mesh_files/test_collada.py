"""Collada: pictures found, lost pictures named, damaged files refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from moveit6d.errors import InputError
from moveit6d.geometry.mesh import Mesh
from tests.support.collada_files import dae
from tests.support.patches import BOX, all_right


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


def test_a_unit_that_is_not_the_file_s_is_warned_of(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    BOX.write_picture(tmp_path / "skin.png")
    path = tmp_path / "box.dae"
    path.write_text(dae())
    Mesh.load(path, "cm")
    assert not caplog.text
    Mesh.load(path, "m")
    assert (
        "box.dae: by the file one unit is 0.01 m, but the unit given is 1 m; it is 14.1 m across"
        in caplog.text
    )
    caplog.clear()
    path.write_text(dae().replace('<unit name="centimeter" meter="0.01"/>', ""))
    Mesh.load(path, "cm")  # the file says nothing
    assert not caplog.text
