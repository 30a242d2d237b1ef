"""Confidence interval of a success rate after a number of trials."""

import math


def wilson(successes: int, trials: int, z: float = 1.959964) -> tuple[float, float]:
    """Return the Wilson confidence interval of a success rate (E. B. Wilson, JASA 22, 1927, p. 209).

    Args:
        successes: Number of successful trials.
        trials: Number of all trials, at least 1.
        z: Quantile of the standard normal distribution; the default gives an interval of 95 %.

    Returns:
        Lower and upper end of the interval, from 0 to 1; the success rate lies between them, rounding included.
    """
    rate, share = successes / trials, z * z / trials
    centre = rate + share / 2
    reach = math.sqrt(share * (rate * (1 - rate) + share / 4))
    low, high = (centre - reach) / (1 + share), (centre + reach) / (1 + share)
    return max(0.0, min(low, rate)), min(1.0, max(high, rate))
