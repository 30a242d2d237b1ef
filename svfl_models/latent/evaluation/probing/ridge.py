"""Ridge regression whose penalty is chosen on episodes left out of the fit."""

from dataclasses import dataclass

import numpy as np

PENALTIES = 10.0 ** np.arange(-8, 5)
"""Candidate penalties, per sample and for inputs whose mean variance is 1."""
FOLDS = 5


@dataclass(frozen=True, eq=False)
class Ridge:
    """Affine map from D inputs to K targets.

    Attributes:
        centre: Mean of the inputs, shape (D,).
        scale: Root mean square deviation over all inputs, or 1 if all inputs are constant. All inputs share one scale,
            because a scale per input would enlarge a pixel that hardly ever changes, and the one episode in which it
            changes would dominate the result.
        weights: Matrix of the map, shape (D, K).
        offset: Mean of the targets, shape (K,).
    """

    centre: np.ndarray
    scale: float
    weights: np.ndarray
    offset: np.ndarray

    def __call__(self, inputs: np.ndarray) -> np.ndarray:
        """Map inputs (N, D) to targets (N, K)."""
        return np.asarray((inputs - self.centre) / self.scale @ self.weights + self.offset)


def fit_ridge(inputs: np.ndarray, targets: np.ndarray, episode: np.ndarray) -> Ridge:
    """Fit an affine map by least squares, with a separate penalty for each target.

    The penalty is the one of `PENALTIES` that predicts best in cross-validation with a fifth of the episodes left out
    (one episode, if there are fewer than five). With a single episode the smallest penalty is taken. Whole episodes are
    left out because the frames of one episode resemble each other: leaving out single frames would favour too small a
    penalty.

    Args:
        inputs: Inputs, shape (N, D).
        targets: Targets, shape (N, K).
        episode: Index of each row's episode, shape (N,).
    """
    x, y = np.asarray(inputs, np.float64), np.asarray(targets, np.float64)
    folds = min(FOLDS, len(np.unique(episode)))
    fold = np.unique(episode, return_inverse=True)[1] % folds
    errors = np.zeros((len(PENALTIES), y.shape[1]))
    for left_out in range(folds) if folds > 1 else ():
        held = fold == left_out
        for row, one in enumerate(_fits(x[~held], y[~held])):
            errors[row] += np.square(one(x[held]) - y[held]).sum(axis=0)
    best, fits = errors.argmin(axis=0), _fits(x, y)
    weights = np.stack([fits[row].weights[:, column] for column, row in enumerate(best)], axis=1)
    return Ridge(fits[0].centre, fits[0].scale, weights, fits[0].offset)


def _fits(x: np.ndarray, y: np.ndarray) -> list[Ridge]:
    """Return the maps of all penalties, from one eigendecomposition."""
    centre, offset = x.mean(axis=0), y.mean(axis=0)
    scale = float(np.sqrt(x.var(axis=0).mean())) or 1.0
    scaled = (x - centre) / scale
    values, vectors = np.linalg.eigh(scaled.T @ scaled / len(x))
    turned = vectors.T @ (scaled.T @ (y - offset) / len(x))
    return [
        Ridge(centre, scale, vectors @ (turned / (np.maximum(values, 0) + penalty)[:, None]), offset)
        for penalty in PENALTIES
    ]
