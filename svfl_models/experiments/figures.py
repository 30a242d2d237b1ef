"""What the figures of experiments share: colours, error bars, and small files.

Figures are made without pyplot, whose backend and open figures are the user's.
"""

from collections.abc import Sequence
from typing import Literal

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from svfl_models.experiments.results import Cell, Mean, Results
from svfl_models.training.figures import WIDTH_IN

# Okabe and Ito's palette, made to be told apart by colour-blind people.
MODEL_COLOURS = {"svfl": "#0072b2", "cnn": "#d55e00"}
ENCODER_COLOURS = {"v": "#e69f00", "f": "#009e73", "vf": "#0072b2"}
GROUP_COLOURS = {
    "none": "#555555", "C4": "#56b4e9", "D4": "#0072b2", "C8": "#e69f00", "D8": "#d55e00", "D12": "#cc79a7",
}  # fmt: skip


def panels(rows: int, columns: int, height_in: float) -> tuple[Figure, list[Axes]]:
    """A figure of panels side by side that share the y axis."""
    figure = Figure(figsize=(WIDTH_IN, height_in), layout="constrained")
    return figure, list(figure.subplots(rows, columns, sharey=True, squeeze=False).flat)


def best_known(cell: Cell, results: Results) -> Mean | None:
    """Accuracy on the separate test set where there is one, since it is larger; otherwise on the test split, [%]."""
    return cell.separate if results.tested_separately else cell.test


def accuracy_label(results: Results) -> str:
    """Label of an axis of `best_known`."""
    return f"accuracy on the {'separate test set' if results.tested_separately else 'test split'}, %"


def line(axes: Axes, x: Sequence[float], means: Sequence[Mean | None], **style: object) -> None:
    """Means with bars of one standard error; what is missing is left out."""
    known = [(place, mean) for place, mean in zip(x, means, strict=True) if mean]
    if known:
        axes.errorbar(
            [place for place, _ in known], [mean.mean for _, mean in known], [mean.error or 0 for _, mean in known],
            capsize=3, **style,  # type: ignore[arg-type] # styles are Matplotlib's to check
        )  # fmt: skip


def legend(axes: Axes, place: Literal["lower left", "lower right"]) -> None:
    """A legend, if there is anything to explain: not where all runs failed."""
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc=place, fontsize=9)


def few_ticks(axes: Axes, values: Sequence[float], names: Sequence[object] | None = None) -> None:
    """Ticks of the x axis at these values only, also if it is logarithmic."""
    axes.set_xticks(values, [str(name) for name in (names or values)])
    axes.minorticks_off()
    axes.grid(alpha=0.3)
