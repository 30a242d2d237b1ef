"""A sum tree: numbers that change, and which of them a running total falls on, both in logarithmic time.

Source: Schaul, Quan, Antonoglou, Silver, "Prioritized Experience Replay", ICLR 2016, appendix B.2.1.
"""

import numpy as np


class SumTree:
    """Non-negative numbers in fixed places, all zero at first.

    A node is always the sum of its two children, never a sum that is corrected by differences: rounding errors do not
    pile up, and equal numbers give an equal tree, whatever they were before.

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
        """The numbers, shape (size,), float64; not to be written to."""
        return self._nodes[self._leaves : self._leaves + self.size]

    @property
    def nbytes(self) -> int:
        """Memory that it takes, [bytes]."""
        return self._nodes.nbytes

    def __getitem__(self, places: np.ndarray) -> np.ndarray:
        return self.values[places]

    def __setitem__(self, places: np.ndarray, values: np.ndarray | float) -> None:
        """Set numbers; where a place is named more than once, its last number stays.

        Args:
            places: Shape (B,), each in 0 .. size - 1.
            values: Shape (B,) or one for all; finite and not negative.
        """
        nodes = np.asarray(places, np.int64) + self._leaves
        self._nodes[nodes] = values
        for _ in range(self._leaves.bit_length() - 1):
            nodes = nodes >> 1  # siblings meet in one parent, which is then computed twice, to the same result
            self._nodes[nodes] = self._nodes[2 * nodes] + self._nodes[2 * nodes + 1]

    def find(self, amounts: np.ndarray) -> np.ndarray:
        """Places on which running totals fall: the first whose sum with all places before it exceeds the amount.

        Args:
            amounts: Shape (B,), each at least 0 and below `total`, which must be positive.

        Returns:
            Shape (B,), int64. A place whose number is zero is never found, not even if rounding would lead there.
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
