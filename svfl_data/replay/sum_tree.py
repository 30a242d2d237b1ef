"""A sum tree, which changes numbers and finds where their running total exceeds an amount, both in logarithmic time.

Source: Schaul, Quan, Antonoglou, Silver, "Prioritized Experience Replay", ICLR 2016, appendix B.2.1.
"""

import numpy as np


class SumTree:
    """Non-negative numbers in a fixed number of places, all zero at first.

    A node is always computed as the sum of its two children and never updated by a difference. Therefore rounding
    errors do not accumulate, and equal numbers give equal trees, whatever the numbers were before.

    Args:
        size: Number of places.
    """

    def __init__(self, size: int) -> None:
        self.size = size
        self._leaves = 1 << max(0, size - 1).bit_length()
        self._nodes = np.zeros(2 * self._leaves)  # the root is 1, the children of n are 2 n and 2 n + 1

    @property
    def total(self) -> float:
        """Sum of all numbers."""
        return float(self._nodes[1])

    @property
    def values(self) -> np.ndarray:
        """The numbers of all places, shape (size,), float64. This view must not be written to."""
        return self._nodes[self._leaves : self._leaves + self.size]

    @property
    def nbytes(self) -> int:
        """Memory that the tree takes, [bytes]."""
        return self._nodes.nbytes

    def __getitem__(self, places: np.ndarray) -> np.ndarray:
        return self.values[places]

    def __setitem__(self, places: np.ndarray, values: np.ndarray | float) -> None:
        """Set the numbers of places; if a place is given more than once, its last number is kept.

        Args:
            places: Places to set, shape (B,), each in 0 .. size - 1.
            values: Finite, non-negative numbers, shape (B,), or one number for all places.
        """
        nodes = np.asarray(places, np.int64) + self._leaves
        self._nodes[nodes] = values
        for _ in range(self._leaves.bit_length() - 1):
            nodes = nodes >> 1  # siblings meet in one parent, which is then computed twice, to the same result
            self._nodes[nodes] = self._nodes[2 * nodes] + self._nodes[2 * nodes + 1]

    def find(self, amounts: np.ndarray) -> np.ndarray:
        """Find for each amount the first place whose running total, with its own number included, exceeds the amount.

        Args:
            amounts: Amounts, shape (B,), each at least 0 and below `total`, which must be positive.

        Returns:
            Places, shape (B,), int64. A place whose number is zero is never found, not even because of rounding.
        """
        left_over = np.array(amounts, np.float64)
        nodes = np.ones(len(left_over), np.int64)
        for _ in range(self._leaves.bit_length() - 1):
            nodes *= 2
            before = self._nodes[nodes]
            right = (left_over >= before) & (self._nodes[nodes + 1] > 0)
            left_over -= before * right
            nodes += right
        return nodes - self._leaves
