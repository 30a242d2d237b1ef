"""What the reports of all trainings share: learning curves and the table of settings."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from matplotlib.figure import Figure

from svfl_data.system.printable import markdown
from svfl_models.training.writing import write_figure

COLOURS = ("tab:blue", "tab:orange", "tab:green", "tab:red")


@dataclass(frozen=True)
class Panel:
    """Panel of a figure of learning curves.

    Attributes:
        ylabel: Label of the y axis.
        lines: Names of the lines by the metrics that they show.
        factor: Factor that the metrics are multiplied by, such as 100 for shares in per cent.
        log: Whether the y axis is logarithmic.
        ylim: Range of the y axis; None for that of the values.
    """

    ylabel: str
    lines: Mapping[str, str] = field(default_factory=dict)
    factor: float = 1.0
    log: bool = False
    ylim: tuple[float, float] | None = None


def plot_curves(
    history: Sequence[Mapping[str, float]], panels: Sequence[Panel], path: Path, title: str, place: str = "epoch"
) -> None:
    """Draw metrics over the course of a training.

    Args:
        history: Rows of the metrics file. Rows that lack a metric are left out of its line.
        panels: Panels of the figure, from left to right.
        path: PNG file to write.
        title: Title of the figure.
        place: Metric of the x axis; ``epoch``, which counts from 0, is shown counting from 1.
    """
    figure = Figure(figsize=(4.5 * len(panels), 3.4), layout="constrained")
    for axes, panel in zip(figure.subplots(1, len(panels), squeeze=False).flat, panels, strict=True):
        for (metric, name), colour in zip(panel.lines.items(), COLOURS, strict=False):
            rows = [row for row in history if metric in row]
            x = [row[place] + (place == "epoch") for row in rows]
            axes.plot(x, [panel.factor * row[metric] for row in rows], color=colour, label=name)
        axes.set(xlabel=place, ylabel=panel.ylabel)
        axes.set_yscale("log" if panel.log else "linear")
        if panel.ylim:
            axes.set_ylim(panel.ylim)
        if len(panel.lines) > 1:
            axes.legend()
    figure.suptitle(title)
    write_figure(figure, path, dpi=120)


def settings_table(settings: Mapping[str, object]) -> str:
    """Return the settings of a training as a table in Markdown.

    Args:
        settings: Values by their names.
    """
    rows = "\n".join(f"| {name} | {markdown(value)} |" for name, value in settings.items())
    return f"| setting | value |\n| --- | --- |\n{rows}\n"
