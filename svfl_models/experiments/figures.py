"""Colours, panels, error bars and axes that the figures of experiments share.

Figures are made without pyplot, because its backend and open figures belong to the user.
"""

from collections.abc import Sequence
from typing import Literal

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from svfl_models.experiments.results import Cell, Mean, Results
from svfl_models.training.figures import WIDTH_IN

# These colours are of Okabe and Ito's palette, which colour-blind people can tell apart.
MODEL_COLOURS = {"svfl": "#0072b2", "cnn": "#d55e00", "cnn-rotated": "#e69f00"}
ENCODER_COLOURS = {"v": "#e69f00", "f": "#009e73", "vf": "#0072b2"}
GROUP_COLOURS = {
    "none": "#555555", "C4": "#56b4e9", "D4": "#0072b2", "C8": "#e69f00", "D8": "#d55e00", "D12": "#cc79a7",
}  # fmt: skip


def panels(rows: int, columns: int, height_in: float) -> tuple[Figure, list[Axes]]:
    """Make a figure of panels that share the y axis.

    Args:
        rows: Number of rows of panels.
        columns: Number of columns of panels.
        height_in: Height of the figure, in inches.

    Returns:
        The figure, and the axes of its panels row by row.
    """
    figure = Figure(figsize=(WIDTH_IN, height_in), layout="constrained")
    return figure, list(figure.subplots(rows, columns, sharey=True, squeeze=False).flat)


def best_known(cell: Cell, results: Results) -> Mean | None:
    """Return the accuracy of a cell on the larger test set, [%]; None if no finished run of the cell has one.

    The larger test set is the separate one if any run of the experiment was tested on it, otherwise the test split.

    Args:
        cell: Cell of the experiment.
        results: Runs of the experiment.
    """
    return cell.separate if results.tested_separately else cell.test


def accuracy_label(results: Results) -> str:
    """Return the label of an axis that shows the accuracies of `best_known`."""
    return f"accuracy on the {'separate test set' if results.tested_separately else 'test split'}, %"


def line(axes: Axes, x: Sequence[float], means: Sequence[Mean | None], **style: object) -> None:
    """Draw a line of means with error bars of one standard error.

    Args:
        axes: Axes to draw on.
        x: Position of each mean.
        means: Means to draw; those that are None are left out.
        style: Further arguments of Matplotlib's ``Axes.errorbar``.
    """
    known = [(place, mean) for place, mean in zip(x, means, strict=True) if mean]
    if known:
        axes.errorbar(
            [place for place, _ in known], [mean.mean for _, mean in known], [mean.error or 0 for _, mean in known],
            capsize=3, **style,  # type: ignore[arg-type] # styles are Matplotlib's to check
        )  # fmt: skip


def legend(axes: Axes, place: Literal["lower left", "lower right"]) -> None:
    """Add a legend if the axes show anything, which they do not if all runs failed.

    Args:
        axes: Axes to add the legend to.
        place: Corner of the axes for the legend.
    """
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc=place, fontsize=9)


def few_ticks(axes: Axes, values: Sequence[float], names: Sequence[object] | None = None) -> None:
    """Set the ticks of the x axis, which may be logarithmic, to a few values.

    Args:
        axes: Axes to change.
        values: Values that get a tick; all others get none.
        names: Label of each tick. None means the values themselves.
    """
    axes.set_xticks(values, [str(name) for name in (names or values)])
    axes.minorticks_off()
    axes.grid(alpha=0.3)
