import dataclasses
import re

import numpy as np
import pytest

from svfl_data.errors import FormatError, UsageError
from svfl_data.schema.episode import Episode
from svfl_data.signals.transforms import GRAVITY, Gravity, LowPass, Tare, as_record, from_record, processed_wrench
from tests.helpers.builders import episode_arrays, make_episode

OFFSET = (1.0, 2.0, 3.0, 0.1, 0.2, 0.3)


def with_wrench(t_ns, wrench, **proprio):
    arrays = episode_arrays(np.random.default_rng(0))
    arrays["streams/wrench/t_ns"] = np.asarray(t_ns, dtype=np.int64)
    arrays["streams/wrench/wrench"] = np.asarray(wrench, dtype=np.float32)
    if "yaw" in proprio:
        arrays["observations/proprio"][:, 4] = proprio["yaw"]
    return Episode(make_episode().meta, arrays)


def recording(episode, *transforms):
    meta = dataclasses.replace(episode.meta, transforms=[as_record(transform) for transform in transforms])
    return Episode(meta, episode.arrays)


def irregular(rng, n=300):
    return np.cumsum(rng.integers(1, 5, n)) * 1_000_000


def test_without_a_record_the_stored_tare_is_subtracted():
    episode = make_episode()
    np.testing.assert_allclose(processed_wrench(episode), episode.tared_wrench, atol=1e-5)


def test_the_recorded_transforms_are_applied_in_order_and_the_raw_stream_stays():
    rng = np.random.default_rng(0)
    episode = with_wrench(irregular(rng), rng.normal(0, 1, (300, 6)))
    raw = episode.wrench.copy()
    step_by_step = LowPass(20.0).apply(Tare(OFFSET).apply(raw.astype(float), episode), episode)
    np.testing.assert_allclose(
        processed_wrench(recording(episode, Tare(OFFSET), LowPass(20.0))), step_by_step, atol=1e-6
    )
    assert np.array_equal(episode.wrench, raw)


def test_order_matters_where_it_should():
    still = with_wrench(np.arange(2000) * 2_000_000, np.zeros((2000, 6)))
    twice = processed_wrench(recording(still, Tare(OFFSET), Tare(OFFSET)))
    np.testing.assert_allclose(twice, -2 * np.tile(OFFSET, (2000, 1)), rtol=1e-6)


@pytest.mark.parametrize("transform", [Tare(), Tare(OFFSET), LowPass(12.5), Gravity(0.7, (0.0, 0.01, 0.05))])
def test_a_record_gives_the_transform_back(transform):
    assert from_record(as_record(transform), "e") == transform


@pytest.mark.parametrize(
    "record", [{"name": "kalman"}, {"cutoff_hz": 3}, {"name": "low_pass", "order": 4}, {"name": "low_pass"},
               {"name": "low_pass", "cutoff_hz": -1}, {"name": "tare", "offset": [1, 2]}],
)  # fmt: skip
def test_a_transform_that_cannot_be_applied_is_an_error_not_left_out(record):
    episode = make_episode()
    episode = Episode(dataclasses.replace(episode.meta, transforms=[record]), episode.arrays, name="e.hdf5")
    with pytest.raises(FormatError, match=rf"e\.hdf5.*{re.escape(str(record))}.*tare, low_pass, gravity"):
        processed_wrench(episode)


def test_parameters_that_make_no_sense_are_refused():
    for make in (
        lambda: LowPass(0.0),
        lambda: LowPass(float("nan")),
        lambda: Tare((1.0,) * 5),
        lambda: Gravity(-1.0, (0.0, 0.0, 0.0)),
        lambda: Gravity(1.0, (0.0, 0.0)),
    ):
        with pytest.raises(UsageError):
            make()


def test_the_low_pass_keeps_constants_and_is_linear():
    rng = np.random.default_rng(1)
    episode = with_wrench(irregular(rng), np.zeros((300, 6)))
    a, b = rng.normal(0, 1, (2, 300, 6))
    low = LowPass(15.0)
    np.testing.assert_allclose(low.apply(np.ones((300, 6)), episode), 1.0)
    np.testing.assert_allclose(
        low.apply(2 * a + b, episode), 2 * low.apply(a, episode) + low.apply(b, episode), atol=1e-12
    )


def test_the_low_pass_never_sees_the_future():
    rng = np.random.default_rng(2)
    episode = with_wrench(irregular(rng), np.zeros((300, 6)))
    before, after = rng.normal(0, 1, (2, 300, 6))
    after[:120] = before[:120]
    low = LowPass(15.0)
    np.testing.assert_array_equal(low.apply(before, episode)[:120], low.apply(after, episode)[:120])


def test_the_low_pass_follows_a_step_as_the_differential_equation_says_on_irregular_timestamps():
    rng = np.random.default_rng(3)
    t_ns = irregular(rng)
    episode = with_wrench(t_ns, np.zeros((300, 6)))
    step = np.ones((300, 6))
    step[0] = 0.0
    seconds = (t_ns - t_ns[0]) / 1e9
    expected = 1 - np.exp(-2 * np.pi * 15.0 * seconds)
    np.testing.assert_allclose(LowPass(15.0).apply(step, episode)[:, 0], expected, atol=1e-12)


def test_the_low_pass_weakens_its_corner_frequency_to_about_70_percent():
    t_ns = np.arange(20_000) * 100_000
    episode = with_wrench(t_ns, np.zeros((20_000, 6)))
    wave = np.tile(np.sin(2 * np.pi * 15.0 * t_ns / 1e9)[:, None], 6)
    assert LowPass(15.0).apply(wave, episode)[10_000:].max() == pytest.approx(1 / np.sqrt(2), abs=0.01)


@pytest.mark.parametrize("yaw", [0.0, 0.7, -1.5])
def test_gravity_compensation_leaves_nothing_of_a_hanging_weight(yaw):
    mass, centre = 0.73, np.array([0.02, -0.01, -0.05])
    turned = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]]) @ centre
    force = np.array([0.0, 0.0, -mass * GRAVITY])
    load = np.concatenate([force, np.cross(turned, force)])
    episode = with_wrench(np.arange(200) * 2_000_000, np.tile(load, (200, 1)), yaw=yaw)
    left = processed_wrench(recording(episode, Gravity(mass, tuple(centre))))
    np.testing.assert_allclose(left, 0.0, atol=1e-6)


def test_a_clock_that_runs_backwards_does_not_break_the_filter():
    episode = with_wrench([0, 2_000_000, 1_000_000, 4_000_000], np.ones((4, 6)))
    assert np.isfinite(LowPass(15.0).apply(np.ones((4, 6)), episode)).all()
