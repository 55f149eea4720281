"""Six views of an object: each shows its side, upright and unmirrored."""

from __future__ import annotations

import numpy as np
import pytest

from moveit6d.geometry.mesh import Mesh
from moveit6d.rendering.backends import make_renderer
from moveit6d.visualization.six_sides import BACKGROUND, SIDE, VIEWS, six_sides
from tests.support.meshes import colored_box


@pytest.fixture(scope="module")
def tiles() -> dict[str, np.ndarray]:
    """The views of a box with another colour on each side, by the names of the sides."""
    picture = six_sides(colored_box((0.1, 0.06, 0.04)), make_renderer())
    assert picture.shape == (2 * SIDE, 3 * SIDE, 3) and picture.dtype == np.uint8
    rows = picture.reshape(2, SIDE, 3, SIDE, 3).swapaxes(1, 2).reshape(6, SIDE, SIDE, 3)
    return {name: tile for (name, *_), tile in zip(VIEWS, rows, strict=True)}


def test_opposite_sides_have_the_same_outline_and_other_colours(
    tiles: dict[str, np.ndarray],
) -> None:
    middles = {tuple(tile[SIDE // 2, SIDE // 2].tolist()) for tile in tiles.values()}
    assert len(middles) == 6
    corner = round(255 * BACKGROUND)
    assert all((tile[-1, -1] == corner).all() for tile in tiles.values())


@pytest.mark.parametrize(
    ("name", "ratio"), [("+x", 0.06 / 0.04), ("+y", 0.1 / 0.04), ("+z", 0.1 / 0.06)]
)
def test_a_view_has_the_proportions_of_its_side(
    tiles: dict[str, np.ndarray], name: str, ratio: float
) -> None:
    seen = (np.abs(tiles[name].astype(int) - round(255 * BACKGROUND)).max(-1) > 8)[40:]
    rows, columns = np.nonzero(seen)
    width, height = np.ptp(columns) + 1, np.ptp(rows) + 1
    assert width / height == pytest.approx(ratio, rel=0.05)


def test_up_and_right_are_those_of_the_axes() -> None:
    """A small block at the end of +z and −y: seen from +x, +y is right and +z up."""
    corners = np.array([[0, 0, 0], [0, 1, 0], [0, 1, 1], [0, 0, 1]], float)
    sheet = corners * 0.1
    mark = sheet * 0.3 + np.array([0.001, 0.0, 0.07])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    colors = np.array([[200, 0, 0]] * 4 + [[0, 200, 0]] * 4, np.uint8)
    mesh = Mesh.from_arrays(
        "sheet", np.concatenate([sheet, mark]), np.concatenate([faces, faces + 4]),
        vertex_colors=colors,
    )  # fmt: skip
    tile = six_sides(mesh, make_renderer())[:SIDE, :SIDE].astype(int)
    green = np.argwhere(tile[..., 1] > tile[..., 0] + 50).mean(0)
    red = np.argwhere(tile[..., 0] > tile[..., 1] + 50).mean(0)
    assert green[0] < red[0] and green[1] < red[1], "up, and to the left: −y"
