import numpy as np
import pytest
import torch

from svfl_data.errors import TrainingError
from svfl_data.symmetry import ACTION_PARTS, PROPRIO_PARTS, WRENCH_PARTS, Part, act, act_on_direction, element
from svfl_models.networks.action_space import PLANAR
from svfl_models.symmetry.actions import PARTS, act_on_hidden
from svfl_models.symmetry.groups import GROUPS
from svfl_models.symmetry.representations import (
    components,
    direction_type,
    field_type,
    image_type,
    physical,
    plane,
    regular_type,
    restricted,
    stored,
    wrench_parts,
)
from tests.helpers.lifetime import TRIED, named

ALL_PARTS = {**PARTS, "policy": PLANAR.policy_parts}
every_group = pytest.mark.parametrize("group", TRIED, ids=named)


def elements(group):
    """Every element as escnn names it and as a matrix."""
    return zip(plane(group).fibergroup.elements, group.elements, strict=True)


def numbers(parts):
    count = 1 + max(index for part in parts for index in part.index)
    return np.random.default_rng(0).normal(size=(5, count))


def as_stored(parts, values):
    return stored(parts, torch.from_numpy(values)).numpy()


@every_group
@pytest.mark.parametrize("name", ALL_PARTS)
def test_what_is_stored_transforms_by_its_type(group, name):
    parts = ALL_PARTS[name]
    kind, values = field_type(plane(group), group, parts), numbers(parts)
    assert kind.size == components(parts) == as_stored(parts, values).shape[-1]
    for g, matrix in elements(group):
        expected = as_stored(parts, values) @ kind.representation(g).T
        np.testing.assert_allclose(as_stored(parts, act(matrix, values, parts)), expected, atol=1e-12)


@every_group
def test_the_polar_typing_is_right_for_rotations_and_wrong_for_reflections(group):
    parts, wrench = wrench_parts("polar"), numbers(WRENCH_PARTS)
    kind = field_type(plane(group), group, parts)
    for g, matrix in elements(group):
        moved = as_stored(parts, act(matrix, wrench, WRENCH_PARTS))
        typed = as_stored(parts, wrench) @ kind.representation(g).T
        assert np.allclose(moved, typed) == (np.linalg.det(matrix) > 0)


@pytest.mark.parametrize("name", [name for name in ALL_PARTS if name != "proprio"])
def test_physical_numbers_are_read_off_what_is_stored(name):
    parts = ALL_PARTS[name]
    values = torch.from_numpy(numbers(parts))
    assert torch.equal(physical(parts, stored(parts, values)), values)


def test_the_order_of_parts_does_not_matter_to_physical_numbers():
    parts = tuple(reversed(WRENCH_PARTS))
    values = torch.from_numpy(numbers(parts))
    assert not torch.equal(stored(parts, values), stored(WRENCH_PARTS, values))
    assert torch.equal(physical(parts, stored(parts, values)), values)


def test_axial_vectors_are_stored_turned_and_angles_doubled():
    wrench = torch.tensor([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    assert stored(WRENCH_PARTS, wrench).tolist() == [1, 2, 3, -5, 4, 6]
    assert stored(wrench_parts("polar"), wrench).tolist() == wrench.tolist()
    yaw = torch.tensor([0.3, 0.3 + torch.pi])  # the two fingers of a gripper are alike
    torch.testing.assert_close(*stored((Part("angle", (0,)),), yaw[:, None]))


@every_group
def test_hidden_features_are_permuted_by_the_regular_representation(group):
    kind, features = regular_type(plane(group), 2), torch.randn(3, 2 * len(group), dtype=torch.float64)
    for g, matrix in elements(group):
        expected = features @ torch.from_numpy(kind.representation(g)).T
        torch.testing.assert_close(act_on_hidden(group)(matrix, features), expected)


@every_group
def test_seen_by_its_subgroup_a_type_keeps_its_numbers(group):
    """What the smaller group does to them is what the larger one did."""
    subgroup = group.subgroup()
    for whole in (regular_type(plane(group), 2), field_type(plane(group), group, PROPRIO_PARTS)):
        part = restricted(whole, group)
        assert part.size == whole.size
        assert part.fibergroup.order() == len(subgroup)
        for g, matrix in elements(subgroup):
            same = next(h for h, other in elements(group) if np.allclose(matrix, other))
            small = part.gspace.fibergroup.element(g.value)
            np.testing.assert_allclose(part.representation(small), whole.representation(same), atol=1e-12)


@every_group
def test_directions_are_permuted_by_their_type(group):
    """Of C4 and D4; of the larger groups, restricted."""
    subgroup = group.subgroup()
    kind = direction_type(restricted(regular_type(plane(group), 1), group).gspace)
    for g, matrix in elements(subgroup):
        moved = kind.representation(kind.fibergroup.element(g.value)).argmax(axis=0)
        assert moved.tolist() == act_on_direction(matrix, np.arange(4)).tolist()


@every_group
def test_pixels_of_an_image_keep_their_values(group):
    kind = image_type(plane(group), 4)
    assert all(np.array_equal(kind.representation(g), np.eye(4)) for g, _ in elements(group))


@pytest.mark.parametrize("name", ["D4", "D8", "D12"])
def test_a_flip_mirrors_y_as_the_vector_representation_has_it(name):
    space = plane(GROUPS[name])
    np.testing.assert_allclose(space.irrep(1, 1)(space.fibergroup.reflection), element(0, flip=True))


def test_what_cannot_be_is_refused():
    with pytest.raises(TrainingError, match=r"D4 or C4.* 16"):
        direction_type(plane(GROUPS["D8"]))
    with pytest.raises(TrainingError, match=r"torque .*'axail'.* axial, polar"):
        wrench_parts("axail")
    with pytest.raises(TrainingError, match="angle"):
        physical(PROPRIO_PARTS, torch.zeros(6))
    assert physical(ACTION_PARTS, torch.zeros(2, 5)).shape == (2, 5)
