import numpy as np
import pytest
import torch

from svfl_data.errors import TrainingError
from svfl_data.symmetry import PROPRIO_PARTS, WRENCH_PARTS, Part, act, act_on_direction, dihedral, element
from svfl_models.representations import (
    dihedral_space,
    direction_type,
    field_basis,
    field_type,
    regular_type,
    wrench_parts,
)
from svfl_models.testing import act_on_hidden


def stored_as(parts, physical):
    return physical @ field_basis(parts).double().numpy().T


@pytest.mark.parametrize("order", [4, 8])
def test_a_wrench_transforms_by_its_field_type(order):
    space, wrench = dihedral_space(order), np.random.default_rng(0).normal(size=(5, 6))
    kind = field_type(space, WRENCH_PARTS)
    for g, matrix in zip(space.fibergroup.elements, dihedral(order), strict=True):
        moved = stored_as(WRENCH_PARTS, act(matrix, wrench, WRENCH_PARTS))
        np.testing.assert_allclose(moved, stored_as(WRENCH_PARTS, wrench) @ kind.representation(g).T, atol=1e-12)


def test_the_polar_typing_is_right_for_rotations_and_wrong_for_reflections():
    space, wrench = dihedral_space(4), np.random.default_rng(0).normal(size=(5, 6))
    parts = wrench_parts("polar")
    kind = field_type(space, parts)
    for g, matrix in zip(space.fibergroup.elements, dihedral(4), strict=True):
        physical = stored_as(parts, act(matrix, wrench, WRENCH_PARTS))
        typed = stored_as(parts, wrench) @ kind.representation(g).T
        assert np.allclose(physical, typed) == (np.linalg.det(matrix) > 0)


def test_axial_vectors_are_stored_turned():
    wrench = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    assert stored_as(WRENCH_PARTS, wrench).tolist() == [1, 2, 3, -5, 4, 6]
    assert stored_as(wrench_parts("polar"), wrench).tolist() == wrench.tolist()


def test_directions_are_permuted_by_the_quotient_representation():
    space = dihedral_space(4)
    kind = direction_type(space)
    for g, matrix in zip(space.fibergroup.elements, dihedral(4), strict=True):
        assert kind.representation(g).argmax(axis=0).tolist() == act_on_direction(matrix, np.arange(4)).tolist()


@pytest.mark.parametrize("order", [4, 8])
def test_hidden_features_are_permuted_by_the_regular_representation(order):
    space, features = dihedral_space(order), torch.randn(3, 2 * 2 * order, dtype=torch.float64)
    kind = regular_type(space, 2)
    for g, matrix in zip(space.fibergroup.elements, dihedral(order), strict=True):
        expected = features @ torch.from_numpy(kind.representation(g)).T
        torch.testing.assert_close(act_on_hidden(order)(matrix, features), expected)


def test_a_flip_mirrors_y_as_the_vector_representation_has_it():
    space = dihedral_space(4)
    np.testing.assert_allclose(space.irrep(1, 1)(space.fibergroup.reflection), element(0, flip=True))


def test_what_has_no_representation_is_refused():
    with pytest.raises(TrainingError, match="'angle' has no linear representation"):
        field_type(dihedral_space(4), PROPRIO_PARTS)
    with pytest.raises(TrainingError, match="quotient of D4"):
        direction_type(dihedral_space(8))
    with pytest.raises(TrainingError, match="unknown torque typing 'axail'; possible: axial, polar"):
        wrench_parts("axail")
    assert field_type(dihedral_space(4), (Part("vector", (0, 1)),)).size == 2
