"""Curves of fields in the picture of an episode that are drawn from their declarations alone."""

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes

from svfl_data.reports.plot_style import CURVES, DASHES
from svfl_data.schema.action_fields import ACTION, EXPERT_ACTION, planar_action
from svfl_data.schema.episode import Episode
from svfl_data.schema.field import Field
from svfl_data.schema.field_words import by_unit, clock_of, is_wrench, labels, own, title, wrench_groups
from svfl_data.system.printable import printable

MOST_CURVES = 16
"""Largest number of numbers of a row that are drawn as curves."""
WIDTH = 30
"""Largest number of characters of a line of the name of a panel."""
TALLEST_LEGEND = 8
"""Largest number of curves that one column of a legend names."""
INSTEAD = ("streams/tcp/pose", "streams/joints/position")
"""Standard fields that are drawn where there is no proprioception."""


@dataclass(frozen=True, eq=False)
class Curves:
    """The curves of one panel.

    Attributes:
        name: Name of the panel, with the unit, in lines.
        names: Name of each curve, with its unit.
        t_ns: Times of the rows, shape (M,), [ns].
        values: One column for each curve, shape (M, C).
        steps: Whether the values are commands, which hold until the next one.
    """

    name: str
    names: list[str]
    t_ns: np.ndarray
    values: np.ndarray
    steps: bool = False


def is_planar(episode: Episode) -> bool:
    """Return whether ``actions/action`` is the planar action: gripper opening, dx, dy, dz, dtheta."""
    field = episode.declarations.at(ACTION)
    return episode.has("action") and field is not None and field.components == planar_action().components


def wrench_curves(episode: Episode) -> list[Curves]:
    """Return force and torque of each wrench sensor besides ``streams/wrench``, tared if it has a tare.

    Args:
        episode: Episode to draw.
    """
    found = []
    for group in wrench_groups(episode.arrays, episode.declarations):
        field = episode.declarations.at(f"{group}/wrench")
        if field is None or group == "streams/wrench" or not len(episode.arrays[f"{group}/wrench"]):
            continue
        tare = episode.arrays.get(f"{group}/tare")
        tared = tare is not None and tare.shape == (6,)
        offset = tare if tare is not None and tared else np.zeros(6)
        values = np.asarray(episode.arrays[f"{group}/wrench"], np.float64) - offset
        words = "" if tared else "\nnot tared"
        name = title(field).partition("/wrench")[0]
        for what, unit, columns in (("force", "N", slice(0, 3)), ("torque", "N m", slice(3, 6))):
            names = labels(field, (6,))[columns]
            t_ns = episode.arrays[f"{group}/t_ns"]
            found.append(Curves(f"{name}\n{what}, {unit}{words}", names, t_ns, values[:, columns]))
    return found


def field_curves(episode: Episode, planar: bool) -> list[Curves]:
    """Return the curves of actions other than the planar one, and of the user's own fields of few components.

    Args:
        episode: Episode to draw.
        planar: Whether ``actions/action`` is the planar action, which has panels of its own.
    """
    drawn = {ACTION: None, EXPERT_ACTION: None} if planar else {EXPERT_ACTION: None}
    actions = [path for path in episode.arrays if path.startswith("actions/") and path not in drawn]
    instead = [] if episode.has("proprio") else [path for path in INSTEAD if path in episode.arrays]
    others = [field.path for field in own(episode.arrays, episode.declarations)]
    paths = dict.fromkeys([*actions, *instead, *others])
    return [
        curves
        for path in paths
        if (field := episode.declarations.at(path)) and not is_wrench(field) and path != EXPERT_ACTION
        for curves in _of(episode, field)
    ]


def _of(episode: Episode, field: Field) -> list[Curves]:
    array = episode.arrays[field.path]
    row = tuple(array.shape[1:])
    fits = field.grows and not field.image and array.dtype.kind in "biuf" and int(np.prod(row)) <= MOST_CURVES
    if not fits or 0 in array.shape:
        return []
    values = np.asarray(array, np.float64).reshape(len(array), -1)
    words = labels(field, row)
    steps = field.path.startswith("actions/")
    t_ns = episode.arrays[clock_of(field.path)][: len(values) + steps]
    units = by_unit(field, row)
    bare, _, said = title(field).partition(", ")
    return [
        Curves(
            f"{bare}\n{said if len(units) == 1 else unit}",
            [words[column] for column in columns], t_ns, values[:, columns], steps,
        )
        for unit, columns in units.items()
    ]  # fmt: skip


def draw_curves(axis: Axes, episode: Episode, curves: Curves) -> None:
    """Draw the curves of one panel and name its vertical axis.

    Args:
        axis: Axes to draw into.
        episode: Episode to draw.
        curves: Curves to draw.
    """
    values = np.concatenate([curves.values, curves.values[-1:]]) if curves.steps else curves.values
    style = "steps-post" if curves.steps else "default"
    for column, name in enumerate(curves.names):
        color = CURVES[column % len(CURVES)]
        dash = DASHES[(column if len(curves.names) <= len(DASHES) else column // len(CURVES)) % len(DASHES)]
        t_s, curve = curves.t_ns / 1e9, values[:, column]
        axis.plot(t_s, curve, color=color, linestyle=dash, drawstyle=style, linewidth=1.2, label=name)
    lines = [printable(line, WIDTH) for line in curves.name.split("\n") if line]
    axis.set_ylabel("\n".join(lines), fontsize=8)
