"""Confidence intervals of success rates over several seeds: a bootstrap over seeds and over the trials of all seeds.

A policy that is trained once more with another seed succeeds another number of times, so trials of one training are no
independent sample of what a method achieves. The bootstrap therefore draws both: seeds, and the trials (scenes or test
samples), which are the same for all seeds and so are drawn once for all of them (A. B. Owen, Annals of Applied
Statistics 1, 2007: rows and columns of a table are drawn apart). Rates of several tasks are drawn task by task, as
recommended for reinforcement learning (Agarwal et al., NeurIPS 2021, stratified bootstrap and interquartile mean).

Percentiles of a bootstrap over as few as three seeds are far too close (they cover the truth in 76 to 90 % of
simulated cases instead of 95 %). Deviations between seeds are therefore expanded by sqrt(k / (k - 1)) and by the ratio
of Student's to the normal quantile (T. Hesterberg, The American Statistician 69, 2015, section 3.3), which makes it 91
to 100 % (docs/decisions.md).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import stdtrit

from svfl_data.reports.success_rate import wilson

DRAWS = 10_000
LEVEL = 0.95
NORMAL = 1.959964
"""Quantile of the standard normal distribution that belongs to `LEVEL`."""

Rates = NDArray[np.float64]
Statistic = Callable[[Sequence[Rates]], Rates]
"""Function of the rates of each group, shape (..., seeds) each, that gives a number for each draw, shape (...)."""


@dataclass(frozen=True)
class Interval:
    """An estimate with its 95 % interval.

    Attributes:
        value: The estimate, such as a mean success rate, 0..1, or a difference of two, -1..1.
        low: Lower end of the interval.
        high: Upper end of the interval.
        between_seeds: Whether the interval includes the differences between seeds. With a single seed they are unknown,
            and the interval is for newly drawn trials of that very network.
    """

    value: float
    low: float
    high: float
    between_seeds: bool

    @property
    def excludes_zero(self) -> bool:
        """Whether zero lies outside the interval."""
        return not self.low <= 0 <= self.high


def success_rate(trials: ArrayLike) -> Interval:
    """Return the mean success rate of a method over its seeds.

    The interval is never narrower than Wilson's for all trials together, which it has if the seeds do not differ.

    Args:
        trials: Outcome of each trial, 0 or 1, shape (seeds, trials). Trials of the same column are the same for all
            seeds: the same scene or the same test sample.

    Example:
        >>> found = success_rate([[1, 1, 1, 0], [1, 0, 0, 0]])
        >>> found.value
        0.5
    """
    table = np.atleast_2d(np.asarray(trials, dtype=float))
    pooled = wilson(round(table.sum()), table.size)
    if len(table) == 1:
        return Interval(float(table.mean()), *pooled, between_seeds=False)
    low, high = _bootstrap([[table]], _mean)
    return Interval(float(table.mean()), max(0.0, min(low, pooled[0])), min(1.0, max(high, pooled[1])), True)


def difference(trials: ArrayLike, others: ArrayLike) -> Interval:
    """Return the difference of the mean success rates of two methods that were tried in the same trials.

    The interval is never narrower than that of R. G. Newcombe (Statistics in Medicine 17, 1998, method 10) for all
    trials together.

    Args:
        trials: Outcomes of the first method, shape (seeds, trials), see `success_rate`.
        others: Outcomes of the second method, shape (seeds, trials).
    """
    tables = [np.atleast_2d(np.asarray(table, dtype=float)) for table in (trials, others)]
    one, other = (float(table.mean()) for table in tables)
    (low, high), (other_low, other_high) = (wilson(round(table.sum()), table.size) for table in tables)
    least = one - other - np.hypot(one - low, other_high - other)
    most = one - other + np.hypot(high - one, other - other_low)
    known = min(map(len, tables)) > 1
    found = _bootstrap([tables], lambda rates: _mean(rates[:1]) - _mean(rates[1:]))
    return Interval(
        one - other, max(-1.0, min(found[0], float(least))), min(1.0, max(found[1], float(most))), between_seeds=known
    )


def interquartile_mean(tasks: Sequence[ArrayLike]) -> Interval:
    """Return the mean of the middle half of all runs of a method, over several tasks with several seeds each.

    Args:
        tasks: Outcomes for each task, shape (seeds, trials) each. Different tasks have different trials.
    """
    tables = [np.atleast_2d(np.asarray(table, dtype=float)) for table in tasks]
    value = float(_middle([table.mean(axis=1) for table in tables]))
    low, high = _bootstrap([[table] for table in tables], _middle)
    return Interval(value, max(0.0, low), min(1.0, high), between_seeds=min(map(len, tables)) > 1)


def _mean(rates: Sequence[Rates]) -> Rates:
    means: Rates = np.mean([one.mean(axis=-1) for one in rates], axis=0)
    return means


def _middle(rates: Sequence[Rates]) -> Rates:
    """Return the mean between the quartiles, where a run at a quartile counts for the part of it that lies between."""
    ordered = np.sort(np.concatenate(rates, axis=-1), axis=-1)
    count = ordered.shape[-1]
    edges = np.clip(np.arange(count + 1), count / 4, 3 * count / 4)
    weights = np.array([after - before for before, after in pairwise(edges)]) / (count / 2)
    middle: Rates = ordered @ weights
    return middle


def _bootstrap(sets: Sequence[Sequence[Rates]], statistic: Statistic) -> tuple[float, float]:
    """Return the interval of a statistic of success rates.

    Args:
        sets: Tables of outcomes, shape (seeds, trials) each. Those of one set have the same trials.
        statistic: Statistic of the rates of all tables, in their order.

    Returns:
        Lower and upper end. If any table has one seed only, differences between seeds are left out.
    """
    rng = np.random.default_rng(0)
    tables = [table for one in sets for table in one]
    rates = [table.mean(axis=1) for table in tables]
    value = statistic(rates)
    by_trials = statistic([rate + shift[:, None] for rate, shift in zip(rates, _shifts(sets, rng), strict=True)])
    found = by_trials
    if min(map(len, tables)) > 1:
        drawn = [rate[rng.integers(len(rate), size=(DRAWS, len(rate)))] for rate in rates]
        found = found + _expansion(rates) * (statistic(drawn) - value)
    low, high = np.quantile(found, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return float(low), float(high)


def _shifts(sets: Sequence[Sequence[Rates]], rng: np.random.Generator) -> list[Rates]:
    """Return the changes of each table's mean rate when its trials are drawn anew, shape (draws,) each."""
    shifts = []
    for tables in sets:
        sums = np.stack([table.sum(axis=0) for table in tables])  # (tables, trials)
        kinds, counts = np.unique(sums, axis=1, return_counts=True)  # drawing kinds of trials is drawing trials
        trials = sums.shape[1]
        drawn = rng.multinomial(trials, counts / trials, DRAWS) / trials  # (draws, kinds)
        for kind, table in zip(kinds, tables, strict=True):
            shifts.append(drawn @ (kind / len(table)) - table.mean())
    return shifts


def _expansion(rates: Sequence[Rates]) -> float:
    """Return the factor of deviations between few seeds, with Welch's degrees of freedom for several tables."""
    few = min(map(len, rates))
    spreads = np.array([rate.var(ddof=1) / len(rate) for rate in rates])
    if not spreads.any():
        return 1.0  # nothing to expand
    freedom = spreads.sum() ** 2 / sum(spread**2 / (len(rate) - 1) for spread, rate in zip(spreads, rates, strict=True))
    return float(np.sqrt(few / (few - 1)) * stdtrit(freedom, (1 + LEVEL) / 2) / NORMAL)
