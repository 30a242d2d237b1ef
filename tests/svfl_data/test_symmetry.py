"""The action of planar rotations and reflections is a group action, and it is the one that physics demands."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from svfl_data.symmetry import (
    ACTION_PARTS,
    DIRECTIONS,
    OFFSET_PARTS,
    PROPRIO_PARTS,
    WRENCH_PARTS,
    Part,
    act,
    act_on_direction,
    act_on_image,
    border_distance,
    dihedral,
    element,
    nearest_direction,
)

D4 = dihedral(4)
D8 = dihedral(8)
angles = st.floats(-360, 360, allow_nan=False)
flips = st.booleans()


def in_space(matrix: np.ndarray) -> np.ndarray:
    """The planar element as a 3-D one that leaves the vertical alone."""
    out = np.eye(3)
    out[:2, :2] = matrix
    return out


@settings(deadline=None)
@given(angles, flips, st.integers(0, 2**32 - 1))
def test_a_wrench_moves_like_forces_at_contact_points(degrees, flip, seed):
    """Moving the contact points and forces of a scene moves its wrench by `act`, reflections included."""
    rng = np.random.default_rng(seed)
    points, forces = rng.normal(size=(5, 3)), rng.normal(size=(5, 3))
    g = element(degrees, flip)

    def wrench(points, forces):
        return np.concatenate([forces.sum(axis=0), np.cross(points, forces).sum(axis=0)])

    moved = wrench(points @ in_space(g).T, forces @ in_space(g).T)
    np.testing.assert_allclose(act(g, wrench(points, forces), WRENCH_PARTS), moved, atol=1e-12)


def test_a_polar_torque_is_wrong_for_reflections_only():
    """The paper's typing (torque like force) agrees for rotations and fails for every reflection: the liar."""
    polar = (Part("vector", (0, 1)), Part("invariant", (2,)), Part("vector", (3, 4)), Part("invariant", (5,)))
    wrench = np.arange(1.0, 7.0)
    for g in D8:
        agrees = np.allclose(act(g, wrench, polar), act(g, wrench, WRENCH_PARTS))
        assert agrees == (np.linalg.det(g) > 0)


@settings(deadline=None)
@given(angles, flips, angles, flips)
@pytest.mark.parametrize("parts", [ACTION_PARTS, OFFSET_PARTS, PROPRIO_PARTS, WRENCH_PARTS])
def test_act_is_a_group_action(parts, a, flip_a, b, flip_b):
    """Acting with h and then g is acting with g h (angles up to a full turn), and the identity does nothing."""
    values = np.linspace(-1, 1, max(max(part.index) for part in parts) + 1)
    g, h = element(a, flip_a), element(b, flip_b)
    one_by_one, at_once = act(g, act(h, values, parts), parts), act(g @ h, values, parts)
    for part in parts:
        index = list(part.index)
        difference = one_by_one[index] - at_once[index]
        if part.kind == "angle":
            difference = np.sin(difference / 2)
        np.testing.assert_allclose(difference, 0, atol=1e-9)
    np.testing.assert_array_equal(act(np.eye(2), values, parts), values)


@settings(deadline=None)
@given(angles, flips, st.floats(-3, 3))
def test_a_gripper_turns_with_its_scene(degrees, flip, theta):
    """The finger axis, as a line, moves like a vector."""
    g = element(degrees, flip)
    moved = act(g, np.array([1, 0, 0, 0, theta]), PROPRIO_PARTS)[4]
    axis = g @ [np.cos(theta), np.sin(theta)]
    assert abs(abs(axis @ [np.cos(moved), np.sin(moved)]) - 1) < 1e-9


@pytest.mark.parametrize("g", D4)
@pytest.mark.parametrize("size", [5, 6])
def test_a_bright_pixel_moves_like_a_vector(g, size):
    """A mark at image position v (x right, y up, from the centre) is found at R v."""
    centre = (size - 1) / 2
    image = np.zeros((3, size, size))
    image[:, 1, 3] = 1  # row 1, column 3
    moved = g @ [3 - centre, centre - 1]
    row, column = round(centre - moved[1]), round(moved[0] + centre)
    assert act_on_image(g, image)[:, row, column].sum() == 3


def test_images_refuse_angles_that_are_not_exact():
    with pytest.raises(ValueError, match=r"\b90 degrees"):
        act_on_image(element(45), np.zeros((4, 4)))


@pytest.mark.parametrize("g", D4)
def test_directions_permute_like_the_vectors_they_name(g):
    vectors = np.array([[1, 0], [0, 1], [-1, 0], [0, -1]], dtype=float)
    np.testing.assert_array_equal(nearest_direction(vectors), range(len(DIRECTIONS)))
    np.testing.assert_array_equal(act_on_direction(g, np.arange(4)), nearest_direction(vectors @ g.T))
    assert sorted(act_on_direction(g, np.arange(4))) == [0, 1, 2, 3]


def test_border_distance_is_largest_along_a_direction_and_zero_between_two():
    angle = np.deg2rad([0, 30, 45, 100, 135, 180, -90])
    vectors = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    np.testing.assert_allclose(np.rad2deg(border_distance(vectors)), [45, 15, 0, 35, 0, 45, 45], atol=1e-9)


def test_dihedral_groups_are_closed():
    for order in (4, 8, 12):
        elements = dihedral(order)
        assert len(elements) == 2 * order
        for g in elements:
            assert sum(np.allclose(g @ elements[1], h) for h in elements) == 1
