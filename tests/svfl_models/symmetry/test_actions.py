import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from svfl_data.symmetry import act, act_on_direction, element, nearest_direction
from svfl_data.symmetry import act_on_image as act_on_array_image
from svfl_models.symmetry.actions import (
    PARTS,
    act_on_batch,
    act_on_feature_map,
    act_on_hidden,
    act_on_image,
    act_on_invariant,
    act_on_parts,
    act_on_scores,
    augment,
)
from svfl_models.symmetry.groups import GROUPS
from tests.helpers.lifetime import SYMMETRIC, TRIED, named

laws = settings(max_examples=40, deadline=None)
every_group = pytest.mark.parametrize("group", TRIED, ids=named)


@st.composite
def two_elements(draw):
    group = draw(st.sampled_from(SYMMETRIC))
    return group, draw(st.sampled_from(group.elements)), draw(st.sampled_from(group.elements))


@st.composite
def two_pixel_exact_elements(draw):
    group = draw(st.sampled_from(SYMMETRIC))
    return group, draw(st.sampled_from(group.pixel_exact)), draw(st.sampled_from(group.pixel_exact))


@every_group
@pytest.mark.parametrize("name", PARTS)
def test_numbers_move_as_numpy_moves_them(group, name):
    values = np.random.default_rng(0).normal(size=(3, 2, 6))
    for g in group.elements:
        moved = act_on_batch(g, {name: torch.from_numpy(values)})[name]
        np.testing.assert_allclose(moved, act(g, values, PARTS[name]), atol=1e-12)


@every_group
def test_images_and_directions_move_as_numpy_moves_them(group):
    image, direction = torch.randn(2, 4, 6, 6), torch.tensor([0, 1, 2, 3, 3])
    for g in group.pixel_exact:
        moved = act_on_batch(g, {"image": image, "direction": direction})
        assert np.array_equal(moved["image"], act_on_array_image(g, image.numpy()))
        assert moved["direction"].tolist() == act_on_direction(g, direction.numpy()).tolist()


def same_angle_or_number(name, values):
    """Angles that differ by whole turns are the same."""
    return (
        torch.cat([values[..., :4], values[..., 4:].sin(), values[..., 4:].cos()], -1) if name == "proprio" else values
    )


@laws
@given(two_elements(), st.sampled_from(sorted(PARTS)))
def test_numbers_one_after_the_other_is_the_product(drawn, name):
    _, g, h = drawn
    action, values = act_on_parts(PARTS[name]), torch.randn(3, 6, dtype=torch.float64)
    both, product = action(h, action(g, values)), action(h @ g, values)
    torch.testing.assert_close(same_angle_or_number(name, both), same_angle_or_number(name, product))


@laws
@given(two_elements())
def test_hidden_features_one_after_the_other_is_the_product(drawn):
    group, g, h = drawn
    action, values = act_on_hidden(group), torch.randn(3, 2 * len(group))
    assert torch.equal(action(h, action(g, values)), action(h @ g, values))
    assert torch.equal(action(g.T, action(g, values)), values)


@laws
@given(two_pixel_exact_elements())
def test_pixels_and_directions_one_after_the_other_is_the_product(drawn):
    group, g, h = drawn
    for action, values in (
        (act_on_image, torch.randn(2, 3, 4, 4)),
        (act_on_feature_map(group), torch.randn(2, 2 * len(group), 4, 4)),
        (act_on_scores, torch.randn(5, 4)),
        (act_on_invariant, torch.randn(5)),
    ):
        assert torch.equal(action(h, action(g, values)), action(h @ g, values))
        assert torch.equal(action(g.T, action(g, values)), values)


def test_the_highest_score_moves_with_the_label():
    for g in GROUPS["D4"].elements:
        assert act_on_scores(g, torch.eye(4)).argmax(dim=1).tolist() == act_on_direction(g, np.arange(4)).tolist()


def coordinates(size):
    """x right and y up of every pixel, -1..1."""
    place = (torch.arange(size) + 0.5) / size * 2 - 1
    return place.expand(size, size), -place[:, None].expand(size, size)


def spot(x0, y0, size=32, width=0.15):
    x, y = coordinates(size)
    return torch.exp(-((x - x0) ** 2 + (y - y0) ** 2) / (2 * width**2))


def centroid(image):
    x, y = coordinates(image.shape[-1])
    return torch.stack([(image * x).sum((-2, -1)), (image * y).sum((-2, -1))], -1) / image.sum((-2, -1))[..., None]


@laws
@given(st.floats(0, 360), st.booleans())
def test_an_image_turned_by_any_angle_shows_what_was_turned(degrees, flip):
    """By interpolation, to a tenth of a pixel."""
    g = element(degrees, flip)
    moved = act_on_image(g, spot(0.45, 0.1))
    expected = torch.tensor(g @ [0.45, 0.1], dtype=torch.float32)
    torch.testing.assert_close(centroid(moved), expected, atol=0.1 * 2 / 32, rtol=0)


@laws
@given(st.floats(0, 360), st.booleans())
def test_a_round_image_stays_at_any_angle(degrees, flip):
    image = spot(0, 0, width=0.3)
    torch.testing.assert_close(act_on_image(element(degrees, flip), image), image, atol=0.01, rtol=0)


def test_what_turns_in_from_outside_has_the_value_of_the_edge():
    image = torch.full((1, 4, 16, 16), 0.8)
    torch.testing.assert_close(act_on_image(element(45), image), image)


@pytest.mark.parametrize("group", GROUPS.values(), ids=named)
def test_augmented_samples_stay_true(group):
    """The picture, the offset and the label of a sample tell the same story after turning and mirroring."""
    offset = torch.empty(200, 2).uniform_(-0.5, 0.5)
    batch = {
        "image": torch.stack([spot(*place)[None] for place in offset]),
        "offset": offset,
        "wrench": torch.cat([offset, torch.randn(200, 4)], -1)[:, None],
        "direction": torch.from_numpy(nearest_direction(offset.numpy())),
    }
    moved = augment(batch, group)
    torch.testing.assert_close(centroid(moved["image"][:, 0]), moved["offset"], atol=0.02, rtol=0)
    assert moved["direction"].tolist() == nearest_direction(moved["offset"].numpy()).tolist()
    torch.testing.assert_close(moved["wrench"][:, 0, :2], moved["offset"])
    for g in group.pixel_exact:  # every element is drawn
        same = (moved["offset"] - act_on_parts(PARTS["offset"])(g, offset)).norm(dim=1) < 1e-6
        assert same.sum() > 5
        torch.testing.assert_close(moved["wrench"][same], act_on_parts(PARTS["wrench"])(g, batch["wrench"])[same])


def test_what_it_is_not_known_how_to_move_is_refused():
    with pytest.raises(KeyError, match="reward"):
        act_on_batch(element(90), {"reward": torch.zeros(3)})
    with pytest.raises(ValueError, match="four directions"):
        act_on_batch(element(45), {"direction": torch.zeros(3, dtype=torch.int64)})
