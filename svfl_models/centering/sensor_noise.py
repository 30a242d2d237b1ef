"""Adds noise to wrench readings, to measure how much a network depends on a precise sensor."""

from dataclasses import replace

import numpy as np

from svfl_data.sampling.centering_samples import CenteringSamples
from svfl_models.training.augmentation import WHITE


def with_noise(samples: CenteringSamples, level: float) -> CenteringSamples:
    """Return samples with white noise added to their wrench readings; an episode gets the same noise in every call.

    Args:
        samples: The samples; they are not changed.
        level: Standard deviation of the noise in multiples of `WHITE`.
    """
    if level == 0:
        return samples
    drawn = [np.random.default_rng([int(index), 64]).normal(size=samples.wrench.shape[1:]) for index in samples.episode]
    noise = level * np.array(WHITE) * np.stack(drawn)
    return replace(samples, wrench=(samples.wrench + noise).astype(np.float32))
