"""Time stamps in another unit, and streams at another rate than declared, are told from right ones."""

import re

import numpy as np
import pytest

from svfl_data.schema.rates import Found, declared_rates, rate_words


def stream(rate_hz: float, unit_ns: float = 1.0, seconds: float = 2.0) -> Found:
    return Found.of((np.arange(round(rate_hz * seconds)) * 1e9 / rate_hz / unit_ns).astype(np.int64))


@pytest.mark.parametrize("group", ["streams/wrench", "cameras/front", "observations", "extra/tactile"])
@pytest.mark.parametrize("factor", [0.6, 1.0, 1.9])
def test_what_comes_about_as_declared_is_right(group, factor):
    assert rate_words(group, stream(factor * 30), 30.0) is None


@pytest.mark.parametrize(("unit_ns", "unit"), [(1e3, "microseconds"), (1e6, "milliseconds")])
@pytest.mark.parametrize("rate", [20, 500])
def test_another_unit_under_a_declared_rate_is_named(rate, unit_ns, unit):
    words = rate_words("streams/wrench", stream(rate, unit_ns), rate) or ""
    assert re.search(rf"\b{rate} Hz.*\b{unit}\b", words)


@pytest.mark.parametrize("unit_ns", [1e3, 1e6])
@pytest.mark.parametrize(("group", "rate"), [("observations", 20), ("cameras/front", 30), ("streams/wrench", 500)])
def test_another_unit_is_seen_without_a_declared_rate(group, rate, unit_ns):
    assert "must be nanoseconds" in (rate_words(group, stream(rate, unit_ns)) or "")
    assert rate_words(group, stream(rate)) is None


def test_a_driver_that_fell_back_is_named():
    assert re.search(r"\b50 Hz.*\b500 Hz[^;]*$", rate_words("streams/wrench", stream(50), 500.0) or "")


def test_a_clock_that_began_with_the_epoch_is_named():
    epoch = Found(100, 1_700_000_000 * 10**9, 1_700_000_005 * 10**9)
    assert "since the episode" in (rate_words("streams/wrench", epoch, 20.0) or "")


@pytest.mark.parametrize("count", [0, 1, 4])
def test_a_few_readings_say_nothing(count):
    assert rate_words("streams/wrench", Found.of(np.arange(count)), 500.0) is None


@pytest.mark.parametrize("config", [{}, {"rates_hz": 5}, {"rates_hz": {"a": "x", "b": -1, "c": 0}}])
def test_a_configuration_without_rates_declares_none(config):
    assert declared_rates(config) == {}
