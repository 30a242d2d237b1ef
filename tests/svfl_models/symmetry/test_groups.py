import numpy as np
import pytest

from svfl_data.errors import TrainingError
from svfl_data.symmetry import act_on_image
from svfl_models.symmetry.groups import GROUPS, group_named
from tests.helpers.lifetime import named

every_group = pytest.mark.parametrize("group", GROUPS.values(), ids=named)


def place(matrix, elements):
    """Where a matrix stands among elements; empty if nowhere."""
    return [index for index, element in enumerate(elements) if np.allclose(matrix, element, atol=1e-12)]


@every_group
def test_it_is_a_group(group):
    assert np.allclose(group.elements[0], np.eye(2))
    for g in group.elements:
        assert len(place(g, group.elements)) == 1  # nothing twice
        assert len(place(g.T, group.elements)) == 1  # inverses
        np.testing.assert_allclose(g @ g.T, np.eye(2), atol=1e-12)
        assert all(len(place(g @ h, group.elements)) == 1 for h in group.elements)


@every_group
def test_as_many_elements_as_its_name_says(group):
    number = 1 if group.name == "none" else int(group.name[1:])
    assert len(group) == len(group.elements) == number * (2 if group.name[0] == "D" else 1)
    mirrors = [np.linalg.det(g) < 0 for g in group.elements]
    assert sum(mirrors) == (number if group.mirrors else 0)
    assert mirrors == sorted(mirrors)  # rotations first


@every_group
def test_the_pixel_exact_part_is_what_images_can_do(group):
    image = np.arange(36).reshape(6, 6)
    for g in group.elements:
        if place(g, group.pixel_exact):
            assert sorted(act_on_image(g, image).flatten()) == list(range(36))
        else:
            with pytest.raises(ValueError, match="90 degrees"):
                act_on_image(g, image)


@every_group
def test_the_subgroup_is_the_pixel_exact_part(group):
    subgroup = group.subgroup()
    assert len(subgroup) == len(group.pixel_exact) == {"C": 4, "D": 8, "n": 1}[group.name[0]]
    assert all(place(g, group.elements) for g in subgroup.elements)
    assert subgroup.subgroup() is subgroup


def test_an_unknown_group_is_refused_with_the_known_ones():
    assert group_named("D8") is GROUPS["D8"]
    with pytest.raises(TrainingError, match=r"group 'SO2'.* D4, C4, C8, D8, D12, none"):
        group_named("SO2")
