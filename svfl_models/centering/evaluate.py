"""Evaluates a trained network on samples and writes its prediction for each sample."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from svfl_data.sampling.centering_samples import CenteringSamples
from svfl_data.symmetry import border_distance
from svfl_models.centering.config import TrainingConfig
from svfl_models.centering.data import Crops, in_order
from svfl_models.centering.module import CenteringModule, directions
from svfl_models.networks.inputs import INPUTS
from svfl_models.training.writing import write_rows

COLUMNS = ("samples", "episode", "direction", "predicted", "border_deg", "offset_x", "offset_y", "guess_x", "guess_y")


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Predictions of a network together with the true labels.

    Attributes:
        samples: Samples that the network was evaluated on, with their true labels.
        predicted: Predicted direction classes, shape (S,).
        guess: Predicted offsets in image-aligned axes, shape (S, 2), [m]. None if the network predicts directions.
    """

    samples: CenteringSamples
    predicted: np.ndarray
    guess: np.ndarray | None

    @property
    def accuracy(self) -> float:
        """Share of the samples whose direction is predicted correctly, 0..1."""
        return float(np.mean(self.predicted == self.samples.direction))

    @property
    def confusion(self) -> np.ndarray:
        """Number of samples by true (row) and predicted (column) direction, shape (4, 4)."""
        counts = np.zeros((4, 4), dtype=int)
        np.add.at(counts, (self.samples.direction, self.predicted), 1)
        return counts

    @property
    def offset_error_mm(self) -> float | None:
        """Mean distance between the predicted and the true offset, [mm]; None if the network predicts directions."""
        if self.guess is None:
            return None
        return float(1000 * np.linalg.norm(self.guess - self.samples.offset, axis=1).mean())

    @property
    def border_deg(self) -> np.ndarray:
        """Angle between each true offset and the nearest border between two direction classes, shape (S,), [deg]."""
        return np.rad2deg(border_distance(self.samples.offset))


@torch.no_grad()
def evaluate(module: CenteringModule, samples: CenteringSamples, config: TrainingConfig) -> Evaluation:
    """Compute the predictions of a network, in eval mode and from centre crops.

    Args:
        module: The network; it is left in eval mode.
        samples: Samples to evaluate on.
        config: Configuration that gives the inputs, the image size and the crop of the network.

    Returns:
        The predictions together with the samples.
    """
    module.eval()
    crops = Crops(samples, INPUTS[config.encoder], config.image_size, crop=config.crop)
    on_device = (module.transfer_batch_to_device(batch, module.device, 0) for batch in in_order(crops))
    output = torch.cat([module(batch).cpu() for batch in on_device])
    guess = output.numpy() if output.shape[-1] == 2 else None
    return Evaluation(samples, directions(output).numpy(), guess)


def write_predictions(evaluated: dict[str, Evaluation], path: Path) -> None:
    """Write the predictions as a CSV file with the columns `COLUMNS` and one row per sample.

    Args:
        evaluated: Evaluations by the name of their samples, such as ``test``, which stands in the first column.
        path: File to write. Offsets are in [m] and the angle to the class border in [deg].
    """
    rows: list[Iterable[object]] = [COLUMNS]
    for name, one in evaluated.items():
        guesses = [("", "")] * len(one.predicted) if one.guess is None else [_metres(guess) for guess in one.guess]
        for row in range(len(one.predicted)):
            truth = one.samples
            border = f"{one.border_deg[row]:.2f}"
            who = (name, truth.episode[row], truth.direction[row], one.predicted[row], border)
            rows.append([*who, *_metres(truth.offset[row]), *guesses[row]])
    write_rows(path, rows)


def _metres(vector: np.ndarray) -> tuple[str, str]:
    return f"{vector[0]:.5f}", f"{vector[1]:.5f}"
