"""Analysis of errors: by angle to the border of two classes, by length of the offset, and by class."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.special import bdtrc, ndtr

from svfl_data.reports.success_rate import wilson
from svfl_data.symmetry import DIRECTIONS
from svfl_models.centering.report import NAMES
from svfl_models.experiments.figures import ENCODER_COLOURS
from svfl_models.experiments.page import markdown
from svfl_models.experiments.results import Cell
from svfl_models.training import run_folder
from svfl_models.training.figures import WIDTH_IN, save
from svfl_models.training.writing import read_rows

BORDER_DEG = np.arange(0, 50, 5)
LENGTH_MM = np.arange(0, 105, 5)
MOST_DEG = 180.0
FEW = 20
"""Least number of predictions in a bin for which an accuracy is given."""
CHANCE = 1 / len(DIRECTIONS)
"""Accuracy of guessing."""
FAR_DEG = 20.0
"""Least angle from the border of two classes at which an error is none of a few degrees."""
SWAPS_BY_CHANCE = 1 / 6
"""Share of up for down and down for up among errors that take every wrong direction equally often."""
RARE = 0.025
"""Probability of so many swaps or more among arbitrary errors, below which they are told from these."""
ABOVE, AT, BELOW = "above", "at", "below"


@dataclass(frozen=True, eq=False)
class Predictions:
    """Predictions of all finished runs of a cell, on S samples in total.

    Attributes:
        samples: Set that the samples are from: ``separate_test`` if the runs were tested on one, otherwise ``test``.
        direction: True direction classes, shape (S,).
        predicted: Predicted direction classes, shape (S,).
        border_deg: Angle between the true offset and the nearest border of two classes, shape (S,), [deg].
        length_mm: Length of the true offset, shape (S,), [mm].
    """

    samples: str
    direction: np.ndarray
    predicted: np.ndarray
    border_deg: np.ndarray
    length_mm: np.ndarray

    @classmethod
    def of(cls, cell: Cell) -> "Predictions":
        """Read the predictions of a cell's finished runs, which `evaluate.write_predictions` has written."""
        rows = []
        for run in cell.runs:
            if run.result:
                rows += read_rows(run.folder / run_folder.PREDICTIONS)
        samples = "separate_test" if any(row["samples"] == "separate_test" for row in rows) else "test"
        rows = [row for row in rows if row["samples"] == samples]

        def column(name: str) -> np.ndarray:
            return np.array([float(row[name]) for row in rows])

        return cls(
            samples,
            column("direction").astype(int),
            column("predicted").astype(int),
            column("border_deg"),
            1000 * np.hypot(column("offset_x"), column("offset_y")),
        )

    def accuracy_by(self, values: np.ndarray, edges: np.ndarray) -> list[tuple[float, float, int, float]]:
        """Return the accuracy by bins of a quantity.

        Args:
            values: Quantity of each sample, shape (S,), such as `border_deg`.
            edges: Edges of the bins, in increasing order and in the unit of `values`.

        Returns:
            Lower edge, upper edge, number of predictions and accuracy, [%], of each bin with at least `FEW`
            predictions.
        """
        last = values == edges[-1]  # these values belong to the last bin
        place = np.where(last, len(edges) - 2, np.digitize(values, edges) - 1)
        right = self.predicted == self.direction
        bins = []
        for k in range(len(edges) - 1):
            inside = place == k
            if inside.sum() >= FEW:
                bins.append(
                    (float(edges[k]), float(edges[k + 1]), int(inside.sum()), 100 * float(right[inside].mean()))
                )
        return bins

    @property
    def against_chance(self) -> str:
        """How the accuracy compares with guessing, by its 95 % interval: `ABOVE`, `AT` or `BELOW`; empty if unknown."""
        right, count = int((self.predicted == self.direction).sum()), len(self.direction)
        if not count:
            return ""
        low, high = wilson(right, count)
        return ABOVE if low > CHANCE else BELOW if high < CHANCE else AT

    @property
    def confusion(self) -> np.ndarray:
        """Numbers of samples by true (row) and predicted (column) direction, shape (4, 4)."""
        counts = np.zeros((4, 4), dtype=int)
        np.add.at(counts, (self.direction, self.predicted), 1)
        return counts

    @property
    def reading_error_deg(self) -> float | None:
        """Standard deviation of a normal error of the angle that would cause as many wrong predictions, [deg].

        This error would move as many samples across their nearest border as the network predicts wrongly. It says in
        one number how accurately the network reads the direction. None if there are more wrong predictions than any
        such error would cause.
        """
        wrong = float(np.mean(self.predicted != self.direction))
        if wrong > float(np.mean(ndtr(-self.border_deg / MOST_DEG))):
            return None
        low, high = 0.0, MOST_DEG
        while high - low > 1e-3:
            middle = (low + high) / 2
            crossing = float(np.mean(ndtr(-self.border_deg / middle)))
            low, high = (low, middle) if crossing > wrong else (middle, high)
        return high


def section(cells: Sequence[Cell], picture: str) -> str:
    """Return the section of a page on accuracy by angle from the border of two classes, in Markdown.

    Args:
        cells: Cells to compare, with the same number of training samples.
        picture: Name of the file of the section's figure, see `draw`.
    """
    rows, edges, found = (
        [],
        list(pairwise(BORDER_DEG)),
        {NAMES[cell.config.encoder]: Predictions.of(cell) for cell in cells},
    )
    for name, one in found.items():
        bins = {low: f"{accuracy:.1f}" for low, _, _, accuracy in one.accuracy_by(one.border_deg, BORDER_DEG)}
        rows.append([name, *(bins.get(float(low), "-") for low, _ in edges)])
    count = cells[0].config.train_samples
    return f"""\
## Where the errors are

The border of two directions lies at 45 degrees between them, and near it a small error of the estimated offset changes
the class. Accuracy, %, of SVFL with {count} training samples, by the angle between the true offset and the nearest
border, [deg]; all seeds together:

{markdown(["input", *(f"{low} to {high}" for low, high in edges)], rows)}

{" ".join(filter(None, (_chance(found), _readings(found), *map(_opposite, found, found.values()))))}

![errors]({picture})
"""


def _chance(found: Mapping[str, Predictions]) -> str:
    """Return sentences about networks that are not above chance; empty if all are."""
    words = {AT: "within the 95 % interval", BELOW: "outside the 95 % interval"}
    names = {place: [name for name, one in found.items() if one.against_chance == place] for place in words}
    return " ".join(
        f"{place.capitalize()} chance ({CHANCE:.0%} of the directions, {words[place]}): {', '.join(some)}."
        for place, some in names.items()
        if some
    )


def _readings(found: Mapping[str, Predictions]) -> str:
    """Return a sentence about the accuracy of the angle of networks above chance; empty if there are none."""
    above = {name: one.reading_error_deg for name, one in found.items() if one.against_chance == ABOVE}
    words = [f"{error:.1f} ({name})" for name, error in above.items() if error is not None]
    if not words:
        return ""
    return (
        "The same number of errors would result from a normally distributed error of the direction of "
        f"{', '.join(words)} degrees (standard deviation)."
    )


def _opposite(name: str, one: Predictions) -> str:
    """Return a sentence about large errors between up and down; empty if there are none, or the network guesses."""
    far = (one.predicted != one.direction) & (one.border_deg >= FAR_DEG)
    swapped = far & (one.direction % 2 == 1) & (one.predicted == (one.direction + 2) % 4)
    errors, swaps = int(far.sum()), int(swapped.sum())
    if one.against_chance != ABOVE or not swaps:
        return ""
    words = (
        f"Errors of {name} at {FAR_DEG:.0f} degrees or more from a border that take up for down or down for up: "
        f"{swaps} of {errors}"
    )
    if bdtrc(swaps - 1, errors, SWAPS_BY_CHANCE) < RARE:
        words += f", more than the {SWAPS_BY_CHANCE:.0%} of arbitrary errors; "
        words += "a gripper between camera and block can cause this"
    else:
        words += f", not significantly more than the {SWAPS_BY_CHANCE:.0%} of arbitrary errors"
    return f"{words}."


def draw(cells: Sequence[Cell], path: Path) -> Path:
    """Write a figure of accuracy by angle from the border and by length of the offset, and of confusion matrices.

    Args:
        cells: Cells to compare, at most three.
        path: PNG file to write.

    Returns:
        The file.
    """
    figure = Figure(figsize=(WIDTH_IN, 7.2), layout="constrained")
    grid = figure.add_gridspec(2, 6, height_ratios=(1, 1.05))
    border = figure.add_subplot(grid[0, :3])
    length = figure.add_subplot(grid[0, 3:], sharey=border)
    for place, cell in enumerate(cells):
        one = Predictions.of(cell)
        name, colour = NAMES[cell.config.encoder], ENCODER_COLOURS[cell.config.encoder]
        for axes, values, edges in ((border, one.border_deg, BORDER_DEG), (length, one.length_mm, LENGTH_MM)):
            bins = one.accuracy_by(values, edges)
            axes.plot(
                [(low + high) / 2 for low, high, _, _ in bins],
                [share for *_, share in bins],
                "o-",
                color=colour,
                label=name,
            )
        _confusion(figure.add_subplot(grid[1, 2 * place : 2 * place + 2]), one, name)
    border.set(xlabel="angle from the nearest border of two classes, degrees", xlim=(0, 45), xticks=BORDER_DEG)
    length.set(xlabel="length of the offset, mm")
    border.set_ylabel("accuracy, %")
    for axes in (border, length):
        axes.grid(alpha=0.3)
    border.legend(loc="lower right")
    config = cells[0].config
    figure.suptitle(f"SVFL, {config.train_samples} training samples, {_which(cells)} samples, all seeds together")
    return save(figure, path)


def _which(cells: Sequence[Cell]) -> str:
    return Predictions.of(cells[0]).samples


def _confusion(axes: Axes, one: Predictions, name: str) -> None:
    counts = one.confusion
    shares = 100 * counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    axes.imshow(shares, cmap="Blues", vmin=0, vmax=100)
    for (row, column), share in np.ndenumerate(shares):
        words = f"{share:.1f}" if counts[row, column] else "0"
        axes.text(column, row, words, ha="center", va="center", color="white" if share > 50 else "black")
    axes.set(title=f"{name}: % of the true direction", xlabel="predicted", xticks=range(4), yticks=range(4))
    axes.set_xticklabels(DIRECTIONS)
    axes.set_yticklabels(DIRECTIONS)
    axes.set_ylabel("true")
