"""A data set in BOP's layout as the library writes it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from moveit6d.datasets.bop import Instance
from moveit6d.datasets.bop_writer import BopImage, write_bop
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.symmetry import ContinuousSymmetry, Symmetries
from tests.support.bop_by_hand import TURN
from tests.support.meshes import colored_box


@pytest.fixture
def objects(brick: Mesh) -> dict[int, Mesh]:
    axis = ContinuousSymmetry(np.array([0.0, 0.0, 1.0]), np.array([0.01, 0.0, 0.0]))
    return {
        4: replace(brick, symmetries=Symmetries(TURN[None], (axis,))),
        9: colored_box(),
    }


@pytest.fixture
def root(tmp_path: Path, scene: Any, objects: dict[int, Mesh]) -> Path:
    """One scene of three images; object 9 occurs twice in the last, once nearly hidden."""

    def image(number: int) -> BopImage:
        truth = [Instance(4, scene.pose(number), 0.75), Instance(9, scene.pose(number + 1), 0.5)]
        if number == 7:
            truth.append(Instance(9, scene.pose(number + 2), 0.05))
        depth = np.full((120, 160), 0.5 + number / 1000, np.float32)
        return BopImage(3, number, scene.image(number), scene.camera, truth, depth)

    return write_bop(tmp_path / "tiny", "test", objects, map(image, (1, 2, 7)))
