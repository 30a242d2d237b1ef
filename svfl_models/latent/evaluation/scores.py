"""Scores of yes-no answers and of pictures."""

import numpy as np
from scipy.stats import rankdata


def auroc(score: np.ndarray, truth: np.ndarray) -> float | None:
    """Chance that a positive has a higher score than a negative, ties counting half; None without one of either.

    Source: Hanley and McNeil, Radiology 143 (1982), from the sum of ranks (Mann and Whitney).

    Args:
        score: Shape (N,).
        truth: Shape (N,), bool.
    """
    truth = np.asarray(truth, dtype=bool)
    positives, negatives = int(truth.sum()), int((~truth).sum())
    if not positives or not negatives:
        return None
    ranks = rankdata(score)[truth].sum()
    return float((ranks - positives * (positives + 1) / 2) / (positives * negatives))


def f1(said: np.ndarray, truth: np.ndarray) -> float | None:
    """Harmonic mean of precision and recall; None if there is no yes, neither said nor true.

    Args:
        said: Shape (N,), bool.
        truth: Shape (N,), bool.
    """
    said, truth = np.asarray(said, dtype=bool), np.asarray(truth, dtype=bool)
    total = int(said.sum() + truth.sum())
    return float(2 * (said & truth).sum() / total) if total else None


def psnr(picture: np.ndarray, original: np.ndarray) -> np.ndarray:
    """Peak signal-to-noise ratio of pictures whose values are 0 to 1, [dB]; infinite for equal ones.

    Args:
        picture: Shape (N, ...).
        original: The same shape.

    Returns:
        Shape (N,).
    """
    axes = tuple(range(1, np.ndim(original)))
    error = np.square(np.asarray(picture, np.float64) - original).mean(axis=axes)
    with np.errstate(divide="ignore"):
        return np.asarray(-10 * np.log10(error))


def r_squared(guess: np.ndarray, truth: np.ndarray) -> float | None:
    """Share of the variance about the mean that is explained, all columns pooled; None if nothing varies.

    Args:
        guess: Shape (N, K).
        truth: The same shape and unit.
    """
    about = float(np.square(truth - truth.mean(axis=0)).sum())
    scale = float(np.square(truth).sum())
    return None if about <= 1e-12 * scale else 1 - float(np.square(guess - truth).sum()) / about
