"""Accuracies published in the paper, for comparison with the accuracies of a run.

Source: Kohler et al., Symmetric Models for Visual Force Policy Learning (CoRL 2023), block centering in simulation:
test accuracy in per cent, mean and standard error over three seeds, 100 test samples.
"""

CENTERING = {
    ("v", "cnn"): {10: (48.5, 1.8), 25: (53.7, 3.6), 50: (72.2, 2.4), 100: (87.1, 3.8)},
    ("v", "svfl"): {10: (58.3, 5.9), 25: (66.2, 3.4), 50: (81.1, 4.1), 100: (98.6, 2.3)},
    ("f", "cnn"): {10: (42.1, 0.8), 25: (48.8, 1.6), 50: (78.8, 1.9), 100: (87.2, 3.2)},
    ("f", "svfl"): {10: (48.4, 1.7), 25: (61.1, 3.2), 50: (89.2, 2.3), 100: (95.3, 1.1)},
    ("vf", "cnn"): {10: (56.8, 1.4), 25: (72.8, 4.3), 50: (92.1, 6.2), 100: (98.8, 1.1)},
    ("vf", "svfl"): {10: (67.1, 5.1), 25: (77.3, 2.2), 50: (91.8, 4.7), 100: (99.3, 0.4)},
}
"""Mean and standard error of the accuracy, [%], by (encoder, model) and then by the number of training samples."""


def centering_figure(encoder: str, model: str, train_samples: int) -> tuple[float, float] | None:
    """Return the paper's accuracy of a table cell.

    Args:
        encoder: Inputs of the network: ``v``, ``f`` or ``vf``.
        model: Kind of network: ``cnn`` or ``svfl``.
        train_samples: Number of training samples.

    Returns:
        Mean and standard error, [%]; None if the paper has no such cell.
    """
    return CENTERING.get((encoder, model), {}).get(train_samples)


def centering_words(encoder: str, model: str, train_samples: int) -> str:
    """Return the paper's accuracy of a table cell in words, such as ``99.3 +- 0.4 %``, or ``no such cell``.

    Args:
        encoder: Inputs of the network: ``v``, ``f`` or ``vf``.
        model: Kind of network: ``cnn`` or ``svfl``.
        train_samples: Number of training samples.
    """
    figure = centering_figure(encoder, model, train_samples)
    return f"{figure[0]} +- {figure[1]} %" if figure else "no such cell"
