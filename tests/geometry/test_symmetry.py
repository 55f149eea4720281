"""Symmetries: BOP's rule of composition, units, and what is refused."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from moveit6d.errors import InputError
from moveit6d.geometry.symmetry import ContinuousSymmetry, Symmetries

HALF_TURN = [-1, 0, 0, 10, 0, -1, 0, 20, 0, 0, 1, 0, 0, 0, 0, 1]  # about z through (5, 10), mm


def test_without_any_only_the_identity():
    symmetries = Symmetries()
    assert symmetries.is_trivial
    np.testing.assert_array_equal(symmetries.transforms(), np.eye(4)[None])


def test_bop_discrete_is_converted_to_metres():
    symmetries = Symmetries.from_bop({"diameter": 100.0, "symmetries_discrete": [HALF_TURN]})
    transforms = symmetries.transforms()
    assert transforms.shape == (2, 4, 4)
    np.testing.assert_allclose(transforms[1, :3, 3], [0.01, 0.02, 0], atol=1e-12)
    assert not symmetries.is_trivial


def test_bop_continuous_is_cut_into_315_rotations_about_the_offset():
    info = {"symmetries_continuous": [{"axis": [0, 0, 2], "offset": [5, 10, 0]}]}
    transforms = Symmetries.from_bop(info).transforms()
    assert transforms.shape == (315, 4, 4)
    np.testing.assert_array_equal(transforms[0], np.eye(4))
    offset = np.array([0.005, 0.01, 0.3, 1])  # any point of the axis stays where it is
    np.testing.assert_allclose(transforms @ offset, np.tile(offset, (315, 1)), atol=1e-12)
    steps = np.degrees(np.arccos((np.trace(transforms[1, :3, :3]) - 1) / 2))
    assert steps == pytest.approx(360 / 315)


def test_continuous_is_composed_on_the_left_of_discrete():
    tilt = np.diag([1.0, -1, -1, 1])  # half a turn about x
    axis = ContinuousSymmetry(np.array([0.0, 0, 1]), np.zeros(3))
    transforms = Symmetries(tilt[None], (axis,)).transforms(step_degrees=90)
    assert transforms.shape == (8, 4, 4)
    quarter = np.array([[0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])
    np.testing.assert_allclose(transforms[1], quarter, atol=1e-12)
    np.testing.assert_allclose(transforms[5], quarter @ tilt, atol=1e-12)


def test_two_axes_stand_side_by_side():
    axes = tuple(ContinuousSymmetry(np.eye(3)[k], np.zeros(3)) for k in (0, 2))
    assert len(Symmetries(continuous=axes).transforms(step_degrees=90)) == 1 + 3 + 3


def test_an_identity_among_the_discrete_ones_is_not_repeated():
    assert len(Symmetries(np.eye(4)[None]).transforms()) == 1


def test_a_sphere_symmetry_leaves_the_point_set_unchanged():
    symmetries = Symmetries.from_bop({"symmetries_discrete": [HALF_TURN]})
    points = np.array([[0.005, 0.01, 0], [0.015, 0.01, 0], [-0.005, 0.01, 0]])
    moved = points @ symmetries.transforms()[1, :3, :3].T + symmetries.transforms()[1, :3, 3]
    np.testing.assert_allclose(moved, points[[0, 2, 1]], atol=1e-12)


@pytest.mark.parametrize(
    ("info", "words"),
    [
        ({"symmetries_discrete": [[1, 0, 0]]}, "must be 16 numbers, found 3"),
        ({"symmetries_discrete": [[-1, *HALF_TURN[1:5], 1, *HALF_TURN[6:]]]}, "not a rotation"),
        ({"symmetries_continuous": [{"axis": [0, 0, 0]}]}, "axis has no direction"),
    ],
)
def test_bad_entries_are_refused(info, words):
    with pytest.raises(InputError, match=words):
        Symmetries.from_bop(info)


def test_bad_steps_are_refused():
    with pytest.raises(InputError, match="step_degrees"):
        Symmetries().transforms(step_degrees=0)


TURN_Z = [0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]
TURN_X = [1, 0, 0, 0, 0, 0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 1]


def turned(angle: float, digits: int) -> np.ndarray:
    """A turn by this angle, degrees, about an upright axis through (10, 20, 0) mm, rounded."""
    axis = ContinuousSymmetry(np.array([0.0, 0, 1]), np.array([0.01, 0.02, 0]))
    return axis.turn(np.radians(angle)).round(digits)


@pytest.mark.parametrize(("angle", "count"), [(90, 4), (45, 8), (120, 3), (180, 2), (33, 2)])
def test_products_of_what_is_declared_are_added_where_they_end(angle: float, count: int) -> None:
    motions = Symmetries(turned(angle, 3)[None]).closed().transforms()
    assert len(motions) == count  # 33 degrees have 120 multiples
    point = np.array([0.01, 0.02, 0.3, 1])
    np.testing.assert_allclose(motions @ point, np.tile(point, (count, 1)), atol=1e-2)
    turns = np.degrees(np.arctan2(motions[:, 1, 0], motions[:, 0, 0])) % 360
    np.testing.assert_allclose(turns, angle * np.arange(count), atol=0.1)


def test_a_complete_list_stays_as_it_is() -> None:
    cube = np.tile(np.eye(4), (24, 1, 1))
    cube[:, :3, :3] = Rotation.create_group("O").as_matrix()
    complete = Symmetries(cube)
    assert complete.closed() is complete
    without = Symmetries(cube[np.trace(cube, axis1=1, axis2=2) < 3.9])  # without the identity
    assert without.closed() is without and len(without.discrete) == 23
    generators = Symmetries.from_bop({"symmetries_discrete": [TURN_Z, TURN_X]})
    assert len(generators.closed().transforms()) == 24
    half = [-0.999964, -0.00333777, -0.0077452, 0.232611, 0.00321462, -0.999869, 0.0158593]
    half += [0.694388, -0.00779712, 0.0158338, 0.999844, -0.0792063, 0, 0, 0, 1]
    measured = Symmetries.from_bop({"symmetries_discrete": [half]})  # LM-O's egg box
    assert measured.closed() is measured


@pytest.mark.parametrize(
    ("axis", "offset", "words"),
    [
        ([0, 0, 2], [0, 0, 0], "the axis must have length 1, found 2"),
        ([0, 0, 0], [0, 0, 0], "the axis must have length 1, found 0"),
        ([0, 0, np.nan], [0, 0, 0], "the axis must be 3 finite numbers"),
        ([0, 0, 1], [0, np.inf, 0], "the offset must be 3 finite numbers"),
        ([0, 1], [0, 0, 0], "the axis must be 3 finite numbers"),
        (None, [0, 0, 0], "the axis must be 3 finite numbers"),
        (["z"], [0, 0, 0], "the axis must be numbers"),
    ],
)
def test_what_is_no_axis_is_refused(axis, offset, words):
    with pytest.raises(InputError, match=words):
        ContinuousSymmetry(axis, offset)


def test_an_axis_may_be_a_list_of_few_digits():
    symmetry = ContinuousSymmetry([0.577, 0.577, 0.577], [0, 0, 0])
    assert np.linalg.norm(symmetry.axis) == pytest.approx(1, abs=1e-12)
    turn = symmetry.turn(1.0)[:3, :3]
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)


def test_what_are_no_symmetries_is_refused():
    axis = ContinuousSymmetry([0, 0, 1], [0, 0, 0])
    assert Symmetries(continuous=[axis]).continuous == (axis,)
    for wrong in (axis, [axis, [0, 0, 1]], None):
        with pytest.raises(InputError, match="must be a list of ContinuousSymmetry"):
            Symmetries(continuous=wrong)
    with pytest.raises(InputError, match="discrete symmetries must be numbers"):
        Symmetries([np.eye(4), np.eye(3)])
