"""Splits by sample that are the same wherever they are drawn: one test set for all, training sets by seed."""

import numpy as np

from svfl_data.errors import DatasetError, UsageError


def train_test_split(labels: np.ndarray, train: int, test: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Draw a training set that is balanced over the classes, and a test set that does not depend on the seed.

    Args:
        labels: Class of each sample, shape (S,).
        train: Samples to train on.
        test: Samples to test on.
        seed: Chooses the training samples among those that are not test samples.

    Returns:
        Indices of the training and of the test samples; disjoint.

    Raises:
        UsageError: If a size is not positive.
        DatasetError: If there are not enough samples.
    """
    if train < 1 or test < 1:
        raise UsageError(f"asked for {train} training and {test} test samples; both must be at least 1")
    if train + test > len(labels):
        raise DatasetError(
            f"asked for {train} training and {test} test samples, but the dataset has {len(labels)}; "
            f"with this test set at most {max(0, len(labels) - test)} can be trained on"
        )
    shuffled = np.random.default_rng(0).permutation(len(labels))  # a constant: every run has the same test set
    test_index, pool = shuffled[:test], np.random.default_rng(seed).permutation(shuffled[test:])
    turn = np.empty(len(pool), dtype=np.int64)  # how many of its class come before it
    for label in np.unique(labels):
        own = labels[pool] == label
        turn[own] = np.arange(own.sum())
    balanced = pool[np.argsort(turn, kind="stable")]
    return balanced[:train], np.sort(test_index)
