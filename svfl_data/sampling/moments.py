"""Mean, spread and range of values, taken chunk by chunk, and the scaling that follows from them.

A mean is subtracted from invariants only, and both components of a vector have one scale. Otherwise scaling would not
commute with rotations and reflections (`svfl_data.symmetry`).

Source of the formula that merges the moments of two chunks: Chan, Golub, LeVeque, "Algorithms for computing the sample
variance", The American Statistician, 1983, equation 2.1.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from svfl_data.symmetry import Part

CONSTANT = 1e-6
"""Scale, in SI units, at or below which a quantity counts as constant and gets the scale 1."""


@dataclass(frozen=True, eq=False)
class Moments:
    """Running mean, spread and range of rows with C components.

    Attributes:
        count: Number of rows so far.
        mean: Mean of each component, shape (C,), float64.
        squares: Sum of squared differences from the mean, shape (C,), float64.
        low: Smallest value of each component, shape (C,), float64; infinite if there are no rows.
        high: Largest value of each component, shape (C,), float64; minus infinity if there are no rows.
    """

    count: int
    mean: np.ndarray
    squares: np.ndarray
    low: np.ndarray
    high: np.ndarray

    @classmethod
    def none(cls, components: int) -> "Moments":
        """Return the moments of no rows.

        Args:
            components: Number of components, C.
        """
        zero = np.zeros(components)
        return cls(0, zero, zero, np.full(components, np.inf), np.full(components, -np.inf))

    def and_also(self, values: np.ndarray) -> "Moments":
        """Return the moments of the rows so far together with more values.

        Args:
            values: Values whose last axis holds the components, shape (..., C).
        """
        rows = values.reshape(-1, values.shape[-1]).astype(np.float64)  # (..., C) -> (rows, C)
        if not len(rows):
            return self
        count, mean = self.count + len(rows), rows.mean(axis=0)
        gap = mean - self.mean
        return Moments(
            count,
            self.mean + gap * (len(rows) / count),
            self.squares + ((rows - mean) ** 2).sum(axis=0) + gap**2 * (self.count * len(rows) / count),
            np.minimum(self.low, rows.min(axis=0)),
            np.maximum(self.high, rows.max(axis=0)),
        )

    def scaling(self, parts: Sequence[Part]) -> tuple[np.ndarray, np.ndarray]:
        """Return the mean to subtract and the scale to divide by, so that scaling commutes with the symmetry group.

        The mean is zero except for invariants. The scale is the root mean square of each part about that mean.

        Args:
            parts: Representations of the C components (`svfl_data.symmetry`).

        Returns:
            Mean and scale, each of shape (C,), float64, in the units of the values. The scale is 1 for a part whose
            root mean square is at most `CONSTANT`.
        """
        mean, scale = np.zeros(len(self.mean)), np.ones(len(self.mean))
        if self.count:
            for part in parts:
                index = list(part.index)
                if part.kind == "invariant":
                    mean[index] = self.mean[index]
                about = self.squares[index] + self.count * (self.mean[index] - mean[index]) ** 2
                spread = float(np.sqrt(about.sum() / (self.count * len(index))))
                scale[index] = spread if spread > CONSTANT else 1.0
        return mean, scale


def statistics(values: np.ndarray, parts: Sequence[Part]) -> tuple[np.ndarray, np.ndarray]:
    """Return the mean and the scale of values in memory, as `Moments.scaling` does.

    Args:
        values: Values whose last axis holds the components, shape (..., C).
        parts: Representations of the C components (`svfl_data.symmetry`).

    Returns:
        Mean and scale, each of shape (C,), float64, in the units of the values.
    """
    return Moments.none(values.shape[-1]).and_also(values).scaling(parts)
