"""The sum tree says what a running sum says, whatever has happened to it before."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from svfl_data.replay.sum_tree import SumTree


def naive_find(values: np.ndarray, amounts: np.ndarray) -> np.ndarray:
    """The law, written as slowly as possible."""
    found = []
    for amount in amounts:
        running = 0.0
        for place, value in enumerate(values):
            running += value
            if running > amount:
                found.append(place)
                break
    return np.array(found, np.int64)


@st.composite
def histories(draw: st.DrawFn, numbers: st.SearchStrategy):
    """A size, and batches of places (repeated ones, too) with their numbers."""
    size = draw(st.integers(1, 40))
    batch = st.lists(st.tuples(st.integers(0, size - 1), numbers), max_size=12)
    return size, draw(st.lists(batch, max_size=6))


def played(size: int, batches: list) -> tuple[SumTree, np.ndarray]:
    tree, values = SumTree(size), np.zeros(size)
    for batch in batches:
        tree[np.array([place for place, _ in batch], np.int64)] = np.array([number for _, number in batch])
        for place, number in batch:
            values[place] = number
    return tree, values


@settings(deadline=None, max_examples=150)
@given(histories(st.integers(0, 1000)), st.integers(0, 2**32 - 1))
def test_whole_numbers_are_exact(history, seed):
    """Sums of whole numbers have no rounding: total, numbers and every place found agree to the bit."""
    tree, values = played(*history)
    assert tree.total == values.sum()
    np.testing.assert_array_equal(tree.values, values)
    if values.any():
        amounts = np.random.default_rng(seed).integers(0, int(values.sum()), 50).astype(float)
        np.testing.assert_array_equal(tree.find(amounts), naive_find(values, amounts))


@settings(deadline=None, max_examples=150)
@given(histories(st.just(0.0) | st.floats(1e-9, 1e9)), st.integers(0, 2**32 - 1))
def test_any_numbers_leave_no_trace_and_zero_is_never_found(history, seed):
    tree, values = played(*history)
    fresh = SumTree(len(values))
    fresh[np.arange(len(values))] = values
    assert tree.total == fresh.total == pytest.approx(values.sum(), rel=1e-12)
    if values.any():
        amounts = np.random.default_rng(seed).random(50) * tree.total
        amounts[0], amounts[1] = 0.0, np.nextafter(tree.total, 0)
        found = tree.find(amounts)
        np.testing.assert_array_equal(found, fresh.find(amounts))
        assert (values[found] > 0).all()
        end = np.cumsum(values)[found]
        near = 1e-9 * tree.total
        assert ((end > amounts - near) & (end - values[found] < amounts + near)).all()


def test_nothing_to_set_and_nothing_to_find_change_nothing():
    tree = SumTree(5)
    tree[np.array([], np.int64)] = np.array([])
    assert tree.total == 0
    assert len(tree.find(np.array([]))) == 0


def test_the_sums_of_neighbours_that_change_together_are_right():
    tree = SumTree(8)
    tree[np.array([2, 3, 3, 2])] = np.array([1.0, 1.0, 5.0, 7.0])
    assert tree.total == 12
    np.testing.assert_array_equal(tree[np.array([2, 3])], [7, 5])
    np.testing.assert_array_equal(tree.find(np.array([0.0, 6.9, 7.0, 11.9])), [2, 2, 3, 3])
