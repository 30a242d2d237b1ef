import dataclasses

import numpy as np

from collectors.simulation.admittance import ZERO, Admittance, AdmittanceConfig

UNFILTERED = AdmittanceConfig(filter_hz=1e9)


def test_a_constant_force_moves_the_gripper_by_force_over_stiffness():
    law = Admittance(AdmittanceConfig(), 0.002)
    force = (10.0, -20.0, 30.0)
    for _ in range(1000):
        law.step(force)
    np.testing.assert_allclose(law.deviation, np.array(force) / AdmittanceConfig().stiffness, rtol=1e-9)
    np.testing.assert_allclose(law.rate, 0.0, atol=1e-12)


def test_no_force_no_deviation():
    law = Admittance(AdmittanceConfig(), 0.002)
    for _ in range(10):
        law.step(ZERO)
    assert law.deviation == law.rate == ZERO


def test_it_converges_to_the_mass_spring_damper():
    """Against the closed form of an underdamped oscillator; implicit Euler is of first order in dt."""
    config = dataclasses.replace(UNFILTERED, stiffness=2500.0, damping=100.0, mass=2.0)
    decay = config.damping / (2 * config.mass)
    omega = np.sqrt(config.stiffness / config.mass - decay**2)
    errors = []
    for dt in (2e-4, 1e-4):
        law, n = Admittance(config, dt), int(0.06 / dt)
        for _ in range(n):
            law.step((1.0, 0.0, 0.0))
        t = n * dt
        exact = (1 - np.exp(-decay * t) * (np.cos(omega * t) + decay / omega * np.sin(omega * t))) / config.stiffness
        errors.append(abs(law.deviation[0] / exact - 1))
    assert errors[0] < 0.01
    assert 1.7 < errors[0] / errors[1] < 2.3


def test_it_only_ever_loses_energy_when_left_alone():
    config = dataclasses.replace(UNFILTERED, damping=1.0)
    law = Admittance(config, 0.002)
    law.rate = (1.0, -0.5, 0.2)
    energy = []
    for _ in range(500):
        law.step(ZERO)
        energy.append(
            config.mass * np.dot(law.rate, law.rate) + config.stiffness * np.dot(law.deviation, law.deviation)
        )
    assert (np.diff(energy) <= 0).all()
