"""More noise on wrench readings than the sensor had: how much a network needs a good sensor."""

from dataclasses import replace

import numpy as np

from svfl_data.sampling.centering_samples import CenteringSamples

WHITE = (0.033, 0.033, 0.133, 0.0017, 0.0017, 0.00033)
"""Standard deviation of one reading (fx, fy, fz, mx, my, mz), [N] and [N m]: a sixth of the noise-free resolution of
OnRobot's HEX-E/H QC (datasheet v1.5), the sensor that the simulation has."""


def with_noise(samples: CenteringSamples, level: float) -> CenteringSamples:
    """Samples whose readings have white noise on top; an episode gets the same noise every time.

    Args:
        samples: The samples; they are not changed.
        level: Standard deviation in multiples of `WHITE`.
    """
    if level == 0:
        return samples
    drawn = [np.random.default_rng([int(index), 64]).normal(size=samples.wrench.shape[1:]) for index in samples.episode]
    noise = level * np.array(WHITE) * np.stack(drawn)
    return replace(samples, wrench=(samples.wrench + noise).astype(np.float32))
