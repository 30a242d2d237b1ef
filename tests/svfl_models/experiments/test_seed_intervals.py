"""Intervals over seeds: they cover the truth, include the differences between seeds, and are the same every time."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from svfl_data.reports.success_rate import wilson
from svfl_models.experiments.seed_intervals import difference, interquartile_mean, success_rate

TRIALS = 60


def width(interval):
    return interval.high - interval.low


@st.composite
def outcomes(draw):
    """Trials of several seeds, each with a rate of its own."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    rates = draw(st.lists(st.floats(0, 1), min_size=2, max_size=6))
    return rng.random((len(rates), TRIALS)) < np.array(rates)[:, None]


@given(outcomes())
@settings(max_examples=30)
def test_an_interval_holds_its_estimate_and_never_less_than_wilsons(trials):
    found = success_rate(trials)
    low, high = wilson(int(trials.sum()), trials.size)
    assert found == success_rate(trials)
    assert found.value == pytest.approx(trials.mean())
    assert 0 <= found.low <= low <= high <= found.high <= 1
    assert found.between_seeds


def test_a_single_seed_has_the_interval_of_its_trials_and_says_so():
    trials = np.arange(TRIALS) < 45
    found = success_rate(trials)
    assert (found.low, found.high) == wilson(45, TRIALS)
    assert not found.between_seeds
    assert not difference(trials, trials).between_seeds
    assert not interquartile_mean([trials, np.stack([trials, trials])]).between_seeds


def test_seeds_that_do_not_differ_have_about_wilsons_interval():
    rng = np.random.default_rng(0)
    trials = np.stack([rng.permutation(TRIALS) < 30 for _ in range(5)])
    assert width(success_rate(trials)) < 1.2 * np.subtract(*wilson(150, 300)[::-1])


@given(st.integers(3, 8))
def test_the_more_seeds_differ_the_wider_the_interval(seeds):
    rng = np.random.default_rng(1)
    widths = []
    for reach in (0, 10, 20, 30):
        counts = np.linspace(30 - reach, 30 + reach, seeds).round()
        widths.append(width(success_rate(np.stack([rng.permutation(TRIALS) < count for count in counts]))))
    assert widths == sorted(widths)
    assert widths[-1] > 2 * widths[0]


def test_trials_that_all_seeds_share_are_no_new_trials():
    """Seeds that succeed in exactly the same scenes say no more about other scenes than one of them."""
    one = np.arange(TRIALS) < 30
    shared = success_rate(np.stack([one] * 4))
    assert width(shared) == pytest.approx(width(success_rate(one)), rel=0.1)


@pytest.mark.parametrize(("seeds", "spread"), [(3, 0.0), (3, 0.1), (5, 0.1), (10, 0.2)])
def test_the_true_rate_is_covered_about_as_often_as_is_said(seeds, spread):
    """Where Wilson's interval of all trials together covers it in 34 to 63 % of the cases if seeds differ."""
    rng = np.random.default_rng([seeds, round(100 * spread)])
    covered, pooled = [], []
    for _ in range(200):
        rates = np.clip(0.5 + spread * rng.normal(size=seeds), 0, 1)
        trials = rng.random((seeds, 100)) < rates[:, None]
        found, (low, high) = success_rate(trials), wilson(int(trials.sum()), trials.size)
        covered.append(found.low <= 0.5 <= found.high)
        pooled.append(low <= 0.5 <= high)
    assert np.mean(covered) > 0.9
    assert spread == 0 or np.mean(pooled) < 0.75


def test_a_difference_of_two_methods_is_told_from_the_noise_of_their_seeds():
    rng = np.random.default_rng(2)

    def method(*rates):
        return rng.random((len(rates), 100)) < np.array(rates)[:, None]

    assert difference(method(0.9, 0.88, 0.92), method(0.5, 0.55, 0.45)).excludes_zero
    noisy = difference(method(0.9, 0.3, 0.6), method(0.2, 0.75, 0.25))
    assert noisy.value > 0.1
    assert not noisy.excludes_zero


@given(outcomes(), outcomes())
@settings(max_examples=30)
def test_a_difference_changes_its_sign_with_the_order_of_the_methods(one, other):
    forth, back = difference(one, other), difference(other, one)
    assert forth.value == pytest.approx(-back.value)
    assert -1 <= forth.low <= forth.value <= forth.high <= 1
    assert forth.low == pytest.approx(-back.high, abs=0.08)  # both are drawn at random


def test_a_task_in_which_one_seed_fails_does_not_move_the_interquartile_mean():
    good = [np.ones((3, 20)), np.ones((3, 20))]
    odd = [np.ones((3, 20)), np.concatenate([np.ones((2, 20)), np.zeros((1, 20))])]
    assert interquartile_mean(good).value == pytest.approx(interquartile_mean(odd).value) == pytest.approx(1)
    assert interquartile_mean([[[1, 0]], [[0, 0]], [[1, 1]], [[1, 0]]]).value == 0.5  # the middle two of four


@pytest.mark.parametrize("trials", range(1, 40))
def test_the_interval_of_all_or_nothing_reaches_the_end(trials):
    """Rounding would leave the rate itself outside."""
    assert wilson(trials, trials)[1] == 1
    assert wilson(0, trials)[0] == 0
