"""`moveit6d doctor --mesh` says and shows what was understood of a mesh file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from moveit6d.cli.common import UNITS
from moveit6d.cli.main import main
from moveit6d.geometry.mesh import METRES
from tests.support.patches import BOX, textured_glb


def test_units_of_the_command_line_are_those_of_meshes() -> None:
    assert set(UNITS) == set(METRES)


def test_a_textured_file_is_described_and_drawn(tmp_path: Path, capsys: Any) -> None:
    textured_glb().write(tmp_path / "box.glb")
    (tmp_path / "box.symmetry.json").write_text('{"symmetries_continuous": [{"axis": [0, 0, 1]}]}')
    picture = tmp_path / "sides.png"
    assert main(["doctor", "--mesh", str(tmp_path / "box.glb"), "--output", str(picture)]) == 0
    said = capsys.readouterr().out
    for words in (
        "m (as the file says)", "0.1 × 0.08 × 0.06 m", "12 of 24 vertices",
        "texture of 96×64 pixels", "skin: texture 0, 96×64 pixels", "0 discrete, 1 axes",
    ):  # fmt: skip
        assert words in said
    sides = np.asarray(Image.open(picture)).astype(int)
    assert sides.shape == (512, 768, 3)
    # Seen from +x: the four patches of that side, each lit from the front.
    middle = sides[108, 128 - 40], sides[108, 128 + 40]
    for color in middle:
        known = [patch[2] for patch in BOX.patches[:4]]
        assert min(np.abs(color - one).max() for one in known) < 20


def test_where_the_origin_lies_is_said_in_both_units(tmp_path: Path, capsys: Any) -> None:
    import trimesh

    box = trimesh.creation.box((18.9, 25.8, 7.5))
    box.apply_translation((9.45, 12.9, 0.0))
    box.export(tmp_path / "box.stl")
    words = ["doctor", "--mesh", str(tmp_path / "box.stl"), "--output", str(tmp_path / "a.png")]
    assert main([*words, "--mesh_unit", "cm"]) == 0
    said = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    assert "x 0 to 18.9 cm (0 to 0.189 m)" in said
    assert "z -3.75 to 3.75 cm (-0.0375 to 0.0375 m)" in said
    textured_glb().write(tmp_path / "box.glb")
    assert main(["doctor", "--mesh", str(tmp_path / "box.glb"), *words[3:]]) == 0
    said = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    assert "x -0.05 to 0.05 m" in said


@pytest.mark.parametrize("unit", ["mm", None])
def test_lost_looks_are_said_with_the_exit_code(
    tmp_path: Path, capsys: Any, unit: str | None
) -> None:
    (tmp_path / "box.obj").write_text(BOX.obj("mtllib gone.mtl\nusemtl skin\n"))
    words = ["doctor", "--mesh", str(tmp_path / "box.obj"), "--output", str(tmp_path / "a.png")]
    if unit is not None:
        assert main([*words, "--mesh_unit", unit]) == 2
        assert "looks like unit 'm'" in capsys.readouterr().err
        return
    assert main(words) == 2
    said = capsys.readouterr().out
    assert "LOST" in said and "gone.mtl" in said and "one flat colour" in said
    assert "guessed: give --mesh_unit" in said and (tmp_path / "a.png").is_file()
