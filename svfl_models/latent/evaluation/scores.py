"""Scores of yes-no predictions, of images and of regressions."""

import numpy as np
from scipy.stats import rankdata


def auroc(score: np.ndarray, truth: np.ndarray) -> float | None:
    """Return the probability that a positive has a higher score than a negative, where ties count half.

    Source: Hanley and McNeil, Radiology 143 (1982), from the sum of ranks (Mann and Whitney).

    Args:
        score: Scores, shape (N,).
        truth: Whether each sample is positive, shape (N,), bool.

    Returns:
        Area under the receiver operating characteristic, 0..1; None if all samples are positive or all are negative.
    """
    truth = np.asarray(truth, dtype=bool)
    positives, negatives = int(truth.sum()), int((~truth).sum())
    if not positives or not negatives:
        return None
    ranks = rankdata(score)[truth].sum()
    return float((ranks - positives * (positives + 1) / 2) / (positives * negatives))


def f1(said: np.ndarray, truth: np.ndarray) -> float | None:
    """Return the harmonic mean of precision and recall.

    Args:
        said: Whether each sample is predicted to be positive, shape (N,), bool.
        truth: Whether each sample is positive, shape (N,), bool.

    Returns:
        F1, 0..1; None if no sample is positive, neither predicted nor true.
    """
    said, truth = np.asarray(said, dtype=bool), np.asarray(truth, dtype=bool)
    total = int(said.sum() + truth.sum())
    return float(2 * (said & truth).sum() / total) if total else None


def psnr(picture: np.ndarray, original: np.ndarray) -> np.ndarray:
    """Return the peak signal-to-noise ratio of images with values 0..1, [dB]; infinite for equal images.

    Args:
        picture: Images to score, shape (N, ...).
        original: Original images, of the same shape.

    Returns:
        Ratio of each image, shape (N,).
    """
    axes = tuple(range(1, np.ndim(original)))
    error = np.square(np.asarray(picture, np.float64) - original).mean(axis=axes)
    with np.errstate(divide="ignore"):
        return np.asarray(-10 * np.log10(error))


def r_squared(guess: np.ndarray, truth: np.ndarray) -> float | None:
    """Return the share of the variance about the mean that is explained, all columns pooled; None if nothing varies.

    Args:
        guess: Guessed values, shape (N, K).
        truth: True values, of the same shape and unit.
    """
    about = float(np.square(truth - truth.mean(axis=0)).sum())
    scale = float(np.square(truth).sum())
    return None if about <= 1e-12 * scale else 1 - float(np.square(guess - truth).sum()) / about
