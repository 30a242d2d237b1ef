"""Model of a real wrist sensor's errors: low-pass, bias drift, white noise and quantisation of the wrench."""

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from collectors.simulation.bounds import NotNegative
from collectors.simulation.linear import product

Six = tuple[NotNegative, NotNegative, NotNegative, NotNegative, NotNegative, NotNegative]
ZEROS: Six = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class NoiseConfig:
    """Noise of a six-axis wrist sensor, per channel (fx, fy, fz, mx, my, mz), [N] and [N m]. Zero switches a part off.

    The default values describe a strain-gauge sensor of the cobot class.

    - `white`: OnRobot, "Datasheet HEX-E/H QC" v1.5, states a noise-free resolution of 0.2 N (fx, fy), 0.8 N (fz),
      0.010 N m (mx, my) and 0.002 N m (mz). Noise-free resolution is a peak-to-peak figure; a sixth of it is taken as
      the standard deviation (6 sigma hold 99.7 % of a Gaussian).
    - `step`: Robotiq, "FT 300-S Force Torque Sensor - Instruction Manual", section 4.4.2 (data stream), states 0.01 N
      and 0.001 N m per count.
    - `drift`: manufacturers say only that thermal drift is normal and strongest in z. The values are our estimate: a
      standard deviation of 0.04 N (0.08 N in z) and 0.002 N m after one minute.
    - `cutoff_hz`: the value is our choice, well above what a 20 Hz policy needs and below the 250 Hz limit of a 500 Hz
      stream.

    Attributes:
        white: Standard deviation of the white noise of a single reading, (6,), [N] and [N m].
        drift: Standard deviation of the bias after one second, (6,), [N/sqrt(s)] and [N m/sqrt(s)]. The bias is a
            random walk.
        step: Quantisation step of a reading, (6,), [N] and [N m].
        cutoff_hz: Corner frequency of the first-order low-pass on the physical wrench, [Hz]; 0 means no filter.
    """

    white: Six = (0.033, 0.033, 0.133, 0.0017, 0.0017, 0.00033)
    drift: Six = (0.005, 0.005, 0.01, 0.00025, 0.00025, 0.00025)
    step: Six = (0.01, 0.01, 0.01, 0.001, 0.001, 0.001)
    cutoff_hz: NotNegative = 150.0

    @classmethod
    def none(cls) -> "NoiseConfig":
        """Return the configuration of an ideal sensor, whose readings are the physical wrench."""
        return cls(white=ZEROS, drift=ZEROS, step=ZEROS, cutoff_hz=0.0)


class SensorNoise:
    """Sensor model that turns physical wrenches into readings, and keeps filter and bias from one chunk to the next."""

    def __init__(self, config: NoiseConfig, dt: float, rng: np.random.Generator) -> None:
        """Start without bias. The filter starts at the first wrench that it is given.

        Args:
            config: Size of each part of the noise.
            dt: Time between readings, [s].
            rng: Source of all random numbers; the same generator state gives the same readings.
        """
        self._config = config
        self._rng = rng
        self._sqrt_dt = math.sqrt(dt)
        # Exact discretisation of a first-order lag: y += gain (u - y).
        self._gain = 1.0 - math.exp(-2.0 * math.pi * config.cutoff_hz * dt) if config.cutoff_hz else 1.0
        self._filtered: NDArray[np.float64] | None = None
        self._bias = np.zeros(6)

    def __call__(self, wrench: NDArray[np.float64]) -> NDArray[np.float64]:
        """Turn a chunk of consecutive physical wrenches into readings.

        Args:
            wrench: Physical wrenches, (n, 6), [N] and [N m], which follow those of the last call.

        Returns:
            Readings in the same axes and about the same point, (n, 6), [N] and [N m].
        """
        noise = self._rng.standard_normal((2, *wrench.shape))
        readings = self._low_pass(wrench)
        walk = self._bias + np.cumsum(noise[0] * np.asarray(self._config.drift) * self._sqrt_dt, axis=0)
        self._bias = walk[-1]
        readings = readings + walk + noise[1] * np.asarray(self._config.white)
        step = np.asarray(self._config.step)
        counts = np.round(readings / np.where(step > 0, step, 1.0))
        return np.where(step > 0, counts * step, readings)

    def _low_pass(self, wrench: NDArray[np.float64]) -> NDArray[np.float64]:
        """Apply the first-order lag to all rows at once: y_n = k sum_i (1-k)^(n-i) u_i + (1-k)^(n+1) y_before."""
        if self._gain == 1.0:
            return wrench
        state = wrench[0] if self._filtered is None else self._filtered
        response, decay = _lag(self._gain, len(wrench))
        out = product(response, wrench) + decay[:, None] * state
        self._filtered = out[-1]
        return out


@cache
def _lag(gain: float, count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the lag's response to each of `count` inputs, (count, count), and to the state before them, (count,)."""
    powers = np.array([(1.0 - gain) ** age for age in range(count + 1)])
    ages = np.subtract.outer(np.arange(count), np.arange(count))
    return gain * np.where(ages >= 0, powers[np.maximum(ages, 0)], 0.0), powers[1:]
