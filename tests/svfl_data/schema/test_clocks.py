"""Declared rates and gaps count: what is slower, coarser or older than was said is found, marked and told."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from svfl_data.checks import check_episode
from svfl_data.datasets.dataset import Dataset
from svfl_data.sampling.samples import Samples
from svfl_data.schema.clocks import Clock
from svfl_data.schema.episode import Episode, Meta
from svfl_data.schema.rates import Found, rate_fault, unit_fault
from svfl_data.storage.store import write_episode
from svfl_data.viewer.entities.episode_source import EpisodeSource
from tests.helpers.spoiled import WRENCH, WRENCH_T, fresh

RATES = {"rates_hz": {"streams/wrench": 500, "observations": 20, "cameras/front": 20}}


def every(period_ns, rows):
    return np.arange(rows, dtype=np.int64) * period_ns


def findings(arrays, config=None, annotations=()):
    meta = Meta("centering", 0, 0, "robot", True, config or {}, annotations=list(annotations))
    return [found for found in check_episode(Episode(meta, arrays)) if found.field.endswith("t_ns")]


@given(rate=st.floats(1, 2000), off=st.floats(0.01, 100), rows=st.integers(0, 200))
def test_a_rate_is_wrong_beyond_a_factor_and_doubtful_beyond_a_tenth(rate, off, rows):
    t_ns = (np.arange(rows) / (rate * off) * 1e9).astype(np.int64)
    fault, factor = rate_fault(Found.of(t_ns), rate), max(off, 1 / off)
    expected = None if rows < 5 or factor < 1.09 else "warning" if factor < 1.98 else "error"
    if not (1.09 <= factor <= 1.11 or 1.98 <= factor <= 2.02):  # whole nanoseconds round
        assert (fault and fault[0]) == expected
    assert rate_fault(Found.of(t_ns), None) is None


@pytest.mark.parametrize(("divisor", "unit"), [(1e3, "microseconds"), (1e6, "milliseconds"), (1e9, "seconds")])
def test_a_clock_of_another_unit_is_named(divisor, unit):
    t_ns = (every(2_000_000, 20_000) / divisor).astype(np.int64)
    severity, words = rate_fault(Found.of(t_ns), 500)
    assert severity == "error"
    assert unit in words or t_ns[-1] < 100  # whole seconds tell little


@pytest.mark.parametrize(
    ("group", "period_ns", "wrong"),
    [
        ("observations", 50_000_000, False), ("observations", 1_000_000, False), ("observations", 50_000, True),
        ("observations", 50, True), ("streams/wrench", 2_000_000, False), ("streams/wrench", 125_000, False),
        ("streams/wrench", 2_000, True), ("cameras/front", 33_000_000, False), ("cameras/front", 33_000, True),
    ],
)  # fmt: skip
def test_time_stamps_that_cannot_be_nanoseconds_are_found_without_a_declared_rate(group, period_ns, wrong):
    assert (unit_fault(group, Found.of(every(period_ns, 20))) is not None) == wrong
    assert unit_fault(group, Found.of(every(period_ns, 2))) is None


def test_validate_compares_with_what_was_declared():
    assert findings(fresh(), RATES) == []
    slow = fresh()
    kept = np.arange(len(slow[WRENCH])) % 10 == 0
    slow[WRENCH_T], slow[WRENCH] = slow[WRENCH_T][kept], slow[WRENCH][kept]
    (found, *_) = findings(slow, RATES)
    assert (found.field, found.severity) == (WRENCH_T, "error")
    assert re.search(r"\b50 Hz.*\b500 Hz", found.words)
    assert not [one for one in findings(slow) if one.severity == "error"]


def test_bursts_have_the_declared_rate_everywhere():
    """A driver that hands over 25 readings at once: the median interval says 10 kHz."""
    arrays = fresh()
    arrays[WRENCH_T] = (np.arange(600) // 25 * 25 + 1) * 2_000_000 + np.arange(600) % 25 * 100_000
    assert not [one for one in findings(arrays, RATES) if one.severity == "error"]
    assert not [one for one in findings(arrays, RATES) if "periods of 0.1 ms" in one.words]
    pytest.importorskip("rerun")
    from svfl_data.viewer.summary_text import summary_text

    shown = EpisodeSource.of(Episode(Meta("centering", 0, 0, "robot", True, RATES), arrays))
    assert "600 readings at 500 Hz as declared" in summary_text(shown, 1.0)
    bare = EpisodeSource.of(Episode(Meta("centering", 0, 0, "robot", True), arrays))
    assert "600 readings at 520 Hz on average" in summary_text(bare, 1.0)


def gap(start, end, stream="streams/wrench"):
    return {"name": "gap", "stream": stream, "start_ns": start, "end_ns": end, "reason": "driver restarted"}


def test_a_declared_gap_is_no_fault_and_an_undeclared_one_is():
    arrays = fresh()
    arrays[WRENCH_T], arrays[WRENCH] = (np.delete(arrays[path], slice(100, 150), axis=0) for path in (WRENCH_T, WRENCH))
    declared = gap(int(arrays[WRENCH_T][99]) + 1, int(arrays[WRENCH_T][100]) - 1)
    assert {one.severity for one in findings(arrays, RATES)} == {"warning"}
    assert findings(arrays, RATES, [declared]) == []
    assert {one.severity for one in findings(arrays, RATES, [gap(0, 1)])} == {"warning"}


@pytest.mark.parametrize("config", [{}, RATES])
def test_a_window_from_before_a_break_is_padding_and_its_age_is_told(config, tmp_path):
    """A sensor dies after 0.7 s of 1.2 s: what follows has windows of the past, all marked."""
    arrays = fresh()
    arrays[WRENCH_T], arrays[WRENCH] = arrays[WRENCH_T][:350], arrays[WRENCH][:350]
    dataset = Dataset.create_or_resume(tmp_path / "d", "centering", 0, {})
    write_episode(Episode(Meta("centering", 0, 0, "robot", True, config), arrays), dataset.episode_path(0))
    samples = Samples(dataset, windows={"streams/wrench/wrench": 16})
    batch = samples.batch(range(len(samples)))
    ages = (arrays["observations/t_ns"][:-1] - arrays[WRENCH_T][-1]) / 1e9
    late = ages > 10 * 0.002
    assert late.any()
    assert not late.all()
    np.testing.assert_array_equal(batch["streams/wrench/padding"].all(axis=1), late)
    np.testing.assert_array_equal(batch["streams/wrench/padding"].any(axis=1), late)
    np.testing.assert_allclose(batch["streams/wrench/age"][late], ages[late], rtol=1e-6)
    assert (batch["streams/wrench/age"][~late] < 0.002).all()
    assert (batch["cameras/front/age"] == 0).all()


@given(
    intervals=st.lists(st.integers(1, 40), min_size=1, max_size=30), now=st.integers(-5, 700),
    start=st.integers(0, 600), length=st.integers(0, 80), rate=st.sampled_from([None, 1e8, 2.5e8]),
)  # fmt: skip
def test_what_is_fresh(intervals, now, start, length, rate):
    """The law, slowly: go back from the moment until a step is too wide or a declared gap begins in it."""
    t_ns = np.cumsum(intervals)
    clock = Clock(rate, ((start, start + length),))
    longest = 10 * 1e9 / rate if rate else 10 * (t_ns[-1] - t_ns[0]) / (len(t_ns) - 1) if len(t_ns) >= 5 else np.inf
    row, later = int(np.searchsorted(t_ns, now, side="right")), now
    while row and later - t_ns[row - 1] <= longest and not (length and t_ns[row - 1] <= start < later):
        row, later = row - 1, t_ns[row - 1]
    assert clock.first_fresh(t_ns, np.array([now])).tolist() == [row]
