"""How well a success rate is known after so many trials."""

import math


def wilson(successes: int, trials: int, z: float = 1.959964) -> tuple[float, float]:
    """Interval of a success rate (E. B. Wilson, JASA 22, 1927, p. 209).

    Args:
        successes: How many.
        trials: Of how many, at least 1.
        z: Quantile of the normal distribution; the default gives 95 %.
    """
    rate, share = successes / trials, z * z / trials
    centre = rate + share / 2
    reach = math.sqrt(share * (rate * (1 - rate) + share / 4))
    return max(0.0, (centre - reach) / (1 + share)), min(1.0, (centre + reach) / (1 + share))
