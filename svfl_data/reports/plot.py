"""One picture of an episode: camera images, force, torque, gripper opening, actions, and annotations.

This module imports Matplotlib, so import it only where a picture is needed. Figures are made without pyplot, because
its backend and its open figures belong to the user.
"""

import io
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec

from svfl_data.reports.plot_curves import TALLEST_LEGEND, Curves, draw_curves, field_curves, is_planar, wrench_curves
from svfl_data.reports.plot_strips import FRAMES as FRAMES  # imported for users of this module
from svfl_data.reports.plot_strips import camera_strip, field_strip, pictured
from svfl_data.reports.plot_style import DASHES, GREY, NAME, TURN, X, Y, Z
from svfl_data.schema.episode import Episode
from svfl_data.schema.field_words import own, wrench_groups
from svfl_data.signals.transforms import processed_wrench, recorded_transforms
from svfl_data.symmetry import DIRECTIONS
from svfl_data.system.atomic_io import write_atomically
from svfl_data.system.printable import printable

MARKS = ("#f0e442", "#56b4e9", "#e69f00", "#cc79a7", "#999999")
WIDTH_IN, STRIP_IN, PANEL_IN, SINGLE_IN, GRIPPER_IN, HEAD_IN = 11.0, 1.75, 1.7, 1.0, 0.8, 1.05
LEFT, LEFT_OF_NAMES = 0.1, 0.13  # left edge of the panels, and where panels have names of several lines
DPI = 110
SAID = 80  # largest number of characters of an instruction
TALLEST_IN = 60.0  # largest height of the picture; with more cameras the panels become lower


def save(episode: Episode, path: Path) -> None:
    """Draw an episode into a PNG file.

    Args:
        episode: Episode to draw.
        path: File to write; replaced if it exists.

    Raises:
        FormatError: If a recorded transform is unknown.
        StorageError: If the file cannot be written. A file that existed before is then unchanged.
    """
    write_atomically(path, png(overview(episode)))


def png(figure: Figure) -> bytes:
    """Return a figure as the content of a PNG file."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI, metadata={"Software": None})
    return buffer.getvalue()


@matplotlib.rc_context({"text.parse_math": False})  # a dollar sign in a name must not start a formula
def overview(episode: Episode) -> Figure:
    """Draw the picture of an episode; the panels below the images have the same time axis.

    Args:
        episode: Episode to draw.

    Raises:
        FormatError: If a recorded transform is unknown.
    """
    strips, panels = _strips(episode), _panels(episode)
    heights = [STRIP_IN] * len(strips) + [panel.height for panel in panels]
    total = min(HEAD_IN + sum(heights), TALLEST_IN)
    figure, left = Figure(figsize=(WIDTH_IN, total)), LEFT_OF_NAMES if any(panel.named for panel in panels) else LEFT
    grid = GridSpec(
        len(heights), 1, figure, height_ratios=heights, hspace=0.12,
        left=left, right=0.86, top=1 - 0.6 / total, bottom=0.45 / total,
    )  # fmt: skip
    figure.suptitle(title(episode), x=left, y=1 - 0.12 / total, ha="left", va="top", fontsize=10)
    axes = [figure.add_subplot(grid[row]) for row in range(len(heights))]
    span, drawn = time_span(episode), axes[len(strips) :]
    for axis, strip in zip(axes, strips, strict=False):
        strip(axis)
    for axis, panel in zip(drawn, panels, strict=True):
        panel.draw(axis)
        _dress(axis, episode, span)
    _marks(drawn[0], episode)
    drawn[-1].set_xlabel("time of the episode clock, s")
    for axis in drawn[:-1]:
        axis.tick_params(labelbottom=False)
    figure.align_ylabels(drawn)
    return figure


def _strips(episode: Episode) -> list[Callable[[Axes], None]]:
    """Return the functions that draw the rows of pictures: images of the cameras, and arrays of large rows."""
    found: list[Callable[[Axes], None]] = []
    for camera in episode.cameras.values():
        for path in episode.declarations.image_paths(camera.name, episode.arrays):
            if len(camera.t_ns):
                found.append(partial(camera_strip, episode=episode, camera=camera, kind=path.rpartition("/")[2]))
    return [*found, *(partial(field_strip, episode=episode, field=field) for field in pictured(episode))]


@dataclass(frozen=True)
class Panel:
    """A plot over time.

    Attributes:
        draw: Function that draws the curves and names the vertical axis.
        height: Height of the panel, [in].
        named: Whether the vertical axis has a name of several lines.
    """

    draw: Callable[[Axes], None]
    height: float = PANEL_IN
    named: bool = False


def _panels(episode: Episode) -> list[Panel]:
    """Return the plots of an episode in their order, at least one; what was not recorded is left out."""
    found = []
    planar = is_planar(episode)
    if episode.has("wrench"):
        found += [Panel(partial(_force, episode=episode)), Panel(partial(_torque, episode=episode))]
    found += [_named(episode, curves) for curves in wrench_curves(episode)]
    if planar or episode.has("proprio"):
        found.append(Panel(partial(_opening, episode=episode, planar=planar), GRIPPER_IN))
    if planar:
        found.append(Panel(partial(_action, episode=episode)))
    return found + [_named(episode, curves) for curves in field_curves(episode, planar)]


def _named(episode: Episode, curves: Curves) -> Panel:
    height = PANEL_IN if len(curves.names) > 1 else SINGLE_IN
    return Panel(partial(draw_curves, episode=episode, curves=curves), height, named=True)


def title(episode: Episode) -> str:
    """Return the title of the picture: two lines on the task, success, label, source and wrench of the episode.

    Args:
        episode: Episode to describe.

    Raises:
        FormatError: If a recorded transform is unknown.
    """
    recorded_transforms(episode)
    meta = episode.meta
    steps = ", then ".join(map(_step_words, meta.transforms or ([{"name": "tare"}] if episode.has("tare") else [])))
    wrench = f"; wrench in base axes, torque about the sensor origin, {f'after {steps}' if steps else 'not tared'}"
    label = ""
    if episode.has("label_offset") and episode.has("label_direction"):
        dx, dy = episode.label_offset * 1e3
        direction = int(episode.label_direction)
        known = DIRECTIONS[direction] if 0 <= direction < len(DIRECTIONS) else f"direction {direction}"
        label = f"; label (yellow arrow): {known}, ({dx:+.1f}, {dy:+.1f}) mm in base x, y"
    seconds = (episode.t_ns[-1] - episode.t_ns[0]) / 1e9
    who = [f'"{printable(meta.instruction, SAID)}"'] if meta.instruction else []
    who += [printable(meta.robot, NAME)] if meta.robot else []
    lines = (
        f"{meta.task}, episode {meta.index}: {'success' if meta.success else 'no success'}"
        f"{''.join(f', {one}' for one in who)}{label}",
        f"{meta.source}, seed {meta.seed}, {len(episode)} steps, {seconds:.2f} s"
        f"{wrench if episode.has('wrench') else ''}",
    )
    return "\n".join(map(printable, lines))


def _step_words(record: dict[str, Any]) -> str:
    parameters = ", ".join(f"{key} {value}" for key, value in record.items() if key != "name")
    return f"{record['name']} ({parameters})" if parameters else str(record["name"])


def time_span(episode: Episode) -> tuple[float, float]:
    """Return the first and the last time of what is drawn of an episode over time, at least 1 ms apart.

    Args:
        episode: Episode with at least one observation.

    Returns:
        First and last time on the episode clock, [s].
    """
    streams = wrench_groups(episode.arrays, episode.declarations)
    streams += [field.group for field in own(episode.arrays, episode.declarations) if field.path.startswith("streams/")]
    clocks = [
        episode.t_ns,
        *(episode.arrays[f"{group}/t_ns"] for group in streams if f"{group}/t_ns" in episode.arrays),
    ]
    low = min(int(t_ns[0]) for t_ns in clocks if len(t_ns)) / 1e9
    high = max(int(t_ns[-1]) for t_ns in clocks if len(t_ns)) / 1e9
    return low, max(high, low + 1e-3)


def _force(axis: Axes, episode: Episode) -> None:
    wrench = processed_wrench(episode)
    norm = np.linalg.norm(wrench[:, :3].astype(np.float64), axis=1)
    axis.plot(episode.wrench_t_ns / 1e9, norm, color="#bbbbbb", linewidth=2.4, label="|f|")
    _lines(axis, episode.wrench_t_ns / 1e9, wrench[:, :3], ("fx", "fy", "fz"))
    axis.set_ylabel("force, N")


def _torque(axis: Axes, episode: Episode) -> None:
    _lines(axis, episode.wrench_t_ns / 1e9, processed_wrench(episode)[:, 3:], ("mx", "my", "mz"))
    axis.set_ylabel("torque, N m")


def _opening(axis: Axes, episode: Episode, planar: bool) -> None:
    if planar and len(episode):
        _steps(axis, episode, episode.action[:, :1], ("commanded",), (TURN,))
    if episode.has("proprio"):
        t, opening = episode.t_ns / 1e9, episode.proprio[:, 0]
        axis.plot(t, opening, color=GREY, marker=".", linestyle="", label="measured", clip_on=False)
    axis.set_ylim(-0.15, 1.15)
    axis.set_yticks([0, 1], ["closed 0", "open 1"])
    axis.set_ylabel("gripper")


def _action(axis: Axes, episode: Episode) -> None:
    if len(episode):
        _steps(axis, episode, episode.action[:, 1:4] * 1e3, ("dx, mm", "dy, mm", "dz, mm"), (X, Y, Z))
        _steps(axis, episode, np.rad2deg(episode.action[:, 4:]), ("dθ, deg",), (TURN,))
    axis.set_ylabel("action, mm, deg")


def _lines(axis: Axes, t: np.ndarray, values: np.ndarray, names: tuple[str, ...]) -> None:
    for column, (name, color, dash) in enumerate(zip(names, (X, Y, Z), DASHES, strict=True)):
        axis.plot(t, values[:, column], color=color, linestyle=dash, linewidth=1.2, label=name)


def _steps(axis: Axes, episode: Episode, values: np.ndarray, names: tuple[str, ...], colors: tuple[str, ...]) -> None:
    """Draw commands as steps, each from its observation to the next one."""
    t = episode.t_ns / 1e9
    held = np.concatenate([values, values[-1:]])
    for column, (name, color) in enumerate(zip(names, colors, strict=True)):
        dash = DASHES[column % len(DASHES)]
        axis.plot(t, held[:, column], color=color, linestyle=dash, drawstyle="steps-post", linewidth=1.3, label=name)


def _dress(axis: Axes, episode: Episode, span: tuple[float, float]) -> None:
    """Set the time range, grid and legend of a panel, and shade the annotated intervals behind the lines."""
    axis.set_xlim(*span)
    axis.grid(alpha=0.3, linewidth=0.5)
    axis.axhline(0, color=GREY, linewidth=0.6)
    for side in ("top", "right"):
        axis.spines[side].set_visible(False)
    axis.axvline(float(episode.t_ns[0]) / 1e9, color=GREY, linewidth=0.8, linestyle=":")
    marks = _intervals(episode, span)
    names = sorted({name for name, _, _ in marks})
    for name, start, end in marks:
        axis.axvspan(start, end, color=MARKS[names.index(name) % len(MARKS)], alpha=0.35, linewidth=0)
    if lines := axis.get_legend_handles_labels()[0]:
        columns = 1 if len(lines) <= TALLEST_LEGEND else 2
        size = 8 if columns == 1 else 6
        axis.legend(loc="center left", bbox_to_anchor=(1.005, 0.5), fontsize=size, frameon=False, ncols=columns)


def _intervals(episode: Episode, span: tuple[float, float]) -> list[tuple[str, float, float]]:
    """Return name, start and end [s] of the annotations, as far as they are inside a time range.

    Annotations without all three, and those that end before they start, are left out: ``svfl-data validate`` reports
    them. Matplotlib fails to draw names far outside the picture.
    """
    known = [
        (printable(one["name"], NAME), one["start_ns"] / 1e9, one["end_ns"] / 1e9)
        for one in episode.meta.annotations
        if isinstance(one, dict) and "name" in one
        if all(isinstance(one.get(key), int) for key in ("start_ns", "end_ns"))
    ]
    inside = [(name, max(begin, span[0]), min(end, span[1])) for name, begin, end in known if begin <= end]
    return [(name, begin, end) for name, begin, end in inside if begin <= end]


def _marks(axis: Axes, episode: Episode) -> None:
    """Write the names of the annotations at the top of a panel, and mark the first observation at its bottom."""
    for name, begin, end in _intervals(episode, axis.get_xlim()):
        place = ((begin + end) / 2, 1)
        axis.annotate(name, place, xycoords=("data", "axes fraction"), ha="center", va="top", fontsize=7)
    start, (low, high) = float(episode.t_ns[0]) / 1e9, axis.get_xlim()
    side = "right" if start - low > (high - low) / 6 else "left"
    axis.annotate(
        " first observation ", (start, 0), xycoords=("data", "axes fraction"), fontsize=7, color=GREY, ha=side,
        va="bottom",
    )  # fmt: skip
