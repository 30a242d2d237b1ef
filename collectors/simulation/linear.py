"""Matrix products and lengths that are the same to the last bit on every processor.

NumPy's ``@``, ``dot`` and ``linalg.norm`` call OpenBLAS, which chooses its code by the processor. That code adds in
another order, or fuses multiplication and addition, so that the last digit differs.
"""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray


def product(a: ArrayLike, b: ArrayLike) -> NDArray[np.float64]:
    """Return the matrix product of `a` and `b`.

    Args:
        a: Matrix, (..., M, K).
        b: Matrix, (K, N), or vector, (K,).

    Returns:
        The product, (..., M, N) or (..., M).
    """
    left, right = np.asarray(a, np.float64), np.asarray(b, np.float64)
    if right.ndim == 1:
        return sum_of_products(left, right)
    return np.stack([sum_of_products(left, column) for column in right.T], axis=-1)


def sum_of_products(a: ArrayLike, b: ArrayLike) -> NDArray[np.float64]:
    """Return the scalar products of the last axes, (...)."""
    products: NDArray[np.float64] = np.multiply(a, b)
    return products.sum(axis=-1)


def length(vector: ArrayLike) -> float:
    """Return the Euclidean length of a vector, (K,)."""
    return math.hypot(*np.asarray(vector, np.float64))
