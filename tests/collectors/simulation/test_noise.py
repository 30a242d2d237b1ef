import dataclasses

import numpy as np
import pytest

from collectors.simulation.noise import NoiseConfig, SensorNoise

DT = 0.002
SILENT = NoiseConfig.none()


def run(config: NoiseConfig, wrench: np.ndarray, seed: int = 0) -> np.ndarray:
    noise = SensorNoise(config, DT, np.random.default_rng(seed))
    return np.concatenate([noise(chunk) for chunk in np.split(wrench, len(wrench) // 25)])


def test_none_changes_nothing():
    wrench = np.random.default_rng(1).normal(size=(100, 6))
    np.testing.assert_array_equal(run(SILENT, wrench), wrench)


def test_white_noise_has_the_stated_deviation_and_no_memory():
    config = dataclasses.replace(SILENT, white=NoiseConfig().white)
    readings = run(config, np.zeros((50_000, 6)))
    np.testing.assert_allclose(readings.std(axis=0), config.white, rtol=0.02)
    scaled = readings / readings.std(axis=0)
    assert np.abs((scaled[1:] * scaled[:-1]).mean(axis=0)).max() < 0.02


def test_drift_grows_with_the_square_root_of_time():
    config = dataclasses.replace(SILENT, drift=(1.0,) * 6)
    ends = np.array([run(config, np.zeros((500, 6)), seed)[-1] for seed in range(300)])  # after 1 s
    np.testing.assert_allclose(ends.std(), 1.0, rtol=0.06)
    quarter = np.array([run(config, np.zeros((125, 6)), seed)[-1] for seed in range(300)])  # after 0.25 s
    np.testing.assert_allclose(quarter.std(), 0.5, rtol=0.06)


def test_readings_are_whole_counts():
    config = NoiseConfig()
    counts = run(config, np.random.default_rng(1).normal(size=(100, 6))) / config.step
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-6)


def test_low_pass_reaches_a_step_with_its_time_constant():
    cutoff = 10.0
    config = dataclasses.replace(SILENT, cutoff_hz=cutoff)
    wrench = np.ones((500, 6))
    wrench[:100] = 0.0
    answer = run(config, wrench)[100:, 0]
    t = DT * np.arange(1, 401)
    np.testing.assert_allclose(answer, 1 - np.exp(-2 * np.pi * cutoff * t), atol=1e-12)


@pytest.mark.parametrize("same", [True, False])
def test_the_seed_decides_the_bytes(same: bool):
    wrench = np.zeros((100, 6))
    a, b = run(NoiseConfig(), wrench, seed=3), run(NoiseConfig(), wrench, seed=3 if same else 4)
    assert (a.tobytes() == b.tobytes()) is same
