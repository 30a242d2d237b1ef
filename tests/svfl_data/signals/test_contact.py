import numpy as np
import pytest

from svfl_data.errors import UsageError
from svfl_data.schema.episode import Episode
from svfl_data.signals.contact import ContactRule, contact_annotations, contact_intervals
from tests.helpers.builders import episode_arrays, make_episode

MS = 1_000_000
SHARP = ContactRule(threshold_n=5.0, release_n=3.0, min_duration_s=0.0, cutoff_hz=0.0)


def wandering(seed, n=2000):
    """A random force that crosses any threshold many times, on irregular timestamps."""
    rng = np.random.default_rng(seed)
    t_ns = np.cumsum(rng.integers(1, 6, n)) * MS
    return t_ns, np.abs(np.convolve(rng.normal(0, 12, n + 15), np.ones(16) / 4, mode="valid")[:n])


def inside(interval, intervals):
    return any(start <= interval[0] and interval[1] <= end for start, end in intervals)


def test_onset_and_offset_are_the_readings_that_cross_with_hysteresis():
    t_ns = np.arange(8) * 10 * MS
    force = np.array([0.0, 4.0, 6.0, 4.0, 6.0, 2.0, 4.0, 0.0])
    assert contact_intervals(t_ns, force, SHARP) == [(20 * MS, 50 * MS)]


def test_a_contact_at_the_end_lasts_until_the_last_reading_and_one_at_the_start_begins_with_the_first():
    t_ns = np.arange(4) * 10 * MS
    assert contact_intervals(t_ns, np.array([9.0, 0.0, 9.0, 9.0]), SHARP) == [(0, 10 * MS), (20 * MS, 30 * MS)]


def test_an_exactly_reached_threshold_is_no_contact():
    assert contact_intervals(np.arange(3) * MS, np.full(3, 5.0), SHARP) == []


@pytest.mark.parametrize("seed", range(10))
def test_a_contact_never_begins_before_the_force_exceeds_and_ends_when_it_is_released(seed):
    t_ns, force = wandering(seed)
    found = contact_intervals(t_ns, force, SHARP)
    assert found
    for start, end in found:
        assert force[t_ns == start] > SHARP.threshold_n
        within = force[(t_ns >= start) & (t_ns < end)]
        assert (within >= SHARP.release_n).all()
        assert end == t_ns[-1] or force[t_ns == end] < SHARP.release_n
    outside = ~np.any([(t_ns >= start) & (t_ns <= end) for start, end in found], axis=0)
    outside[-1] = False  # a contact that begins with the last reading has no length
    assert (force[outside] <= SHARP.threshold_n).all()


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("duration", [0.0, 0.02])
def test_a_higher_threshold_only_takes_away(seed, duration):
    t_ns, force = wandering(seed)
    previous = contact_intervals(t_ns, force, ContactRule(1.0, 0.5, duration))
    for threshold in (2.0, 5.0, 9.0, 1e6):
        found = contact_intervals(t_ns, force, ContactRule(threshold, threshold / 2, duration))
        assert all(inside(interval, previous) for interval in found)
        previous = found
    assert previous == []


@pytest.mark.parametrize("seed", range(10))
def test_debounce_removes_exactly_what_is_shorter(seed):
    t_ns, force = wandering(seed)
    every = contact_intervals(t_ns, force, SHARP)
    for seconds in (0.01, 0.03, 0.1):
        kept = contact_intervals(t_ns, force, ContactRule(5.0, 3.0, seconds, 0.0))
        assert kept == [(start, end) for start, end in every if end - start >= seconds * 1e9]
        assert len(kept) < len(every)


def test_a_blip_is_no_contact_but_the_same_force_held_is():
    t_ns = np.arange(500) * 2 * MS
    blip, held = np.zeros(500), np.zeros(500)
    blip[100:110], held[100:200] = 30.0, 30.0  # 20 ms and 200 ms
    assert contact_intervals(t_ns, blip, ContactRule()) == []
    assert contact_intervals(t_ns, held, ContactRule()) == [(200 * MS, 400 * MS)]


def test_no_readings_no_contact():
    assert contact_intervals(np.zeros(0, dtype=np.int64), np.zeros(0), SHARP) == []
    assert contact_intervals(np.zeros(1, dtype=np.int64), np.ones(1) * 9, SHARP) == []


def pressed(tare_z):
    """Raw readings that are the tare but for 20 N from 300 to 500 ms, on irregular timestamps."""
    arrays = episode_arrays(np.random.default_rng(0))
    t_ns = np.cumsum(np.random.default_rng(1).integers(1, 4, 400)) * MS
    wrench = np.zeros((400, 6), dtype=np.float32)
    wrench[:, 2] = tare_z + np.where((t_ns >= 300 * MS) & (t_ns < 500 * MS), 20.0, 0.0)
    arrays |= {"streams/wrench/t_ns": t_ns, "streams/wrench/wrench": wrench}
    arrays["streams/wrench/tare"] = np.array([0, 0, tare_z, 0, 0, 0], dtype=np.float64)
    return Episode(make_episode().meta, arrays)


@pytest.mark.parametrize("tare_z", [0.0, -40.0])
def test_annotations_are_tared_and_filtered_and_say_by_which_rule(tare_z):
    rule = ContactRule()
    (found,) = contact_annotations(pressed(tare_z), rule)
    assert found["name"] == "contact"
    assert 300 * MS <= found["start_ns"] <= 306 * MS  # the filter may be late, never early
    assert 500 * MS <= found["end_ns"] <= 520 * MS
    assert found["by"]["threshold_n"] == rule.threshold_n
    assert found["by"].keys() >= {"threshold_n", "release_n", "min_duration_s", "cutoff_hz"}


@pytest.mark.parametrize("wrong", [(1.0, 2.0), (0.0, 0.0), (5.0, 2.0, -1.0), (5.0, 2.0, 0.0, -3.0), (float("nan"), 1)])
def test_rules_that_make_no_sense_are_refused(wrong):
    with pytest.raises(UsageError):
        ContactRule(*wrong)
