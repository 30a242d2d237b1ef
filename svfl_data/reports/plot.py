"""One picture of an episode: camera images, force, torque, gripper opening, actions, and annotations.

This module imports Matplotlib, so import it only where a picture is needed. Figures are made without pyplot, because
its backend and its open figures belong to the user.
"""

import io
import math
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec

from svfl_data.schema.episode import Camera, Episode
from svfl_data.signals.transforms import processed_wrench, recorded_transforms
from svfl_data.symmetry import DIRECTIONS
from svfl_data.system.atomic_io import write_atomically
from svfl_data.system.printable import printable

# Okabe and Ito's palette, whose colours colour-blind people can distinguish; x, y, z also differ in their dashes.
X, Y, Z = "#d55e00", "#009e73", "#0072b2"
GREY, TURN, LABEL = "#555555", "#cc79a7", "#f0e442"
MARKS = ("#f0e442", "#56b4e9", "#e69f00", "#cc79a7", "#999999")
DASHES = ("-", (0, (5, 1.5)), (0, (1.5, 1)))

FRAMES = 8  # images in a strip
WIDTH_IN, STRIP_IN, PANEL_IN, GRIPPER_IN, HEAD_IN = 11.0, 1.75, 1.7, 0.8, 1.05
PICTURE = 0.9  # share of a strip's height that the images take; the rest is for the times above them
DPI = 110
NAME = 40  # largest number of characters of a camera's or annotation's name
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
    strips = [(camera, kind) for camera in episode.cameras.values() for kind in ("color", "depth") if camera.has(kind)]
    strips = [(camera, kind) for camera, kind in strips if len(camera.t_ns)]
    heights = [STRIP_IN] * len(strips) + [PANEL_IN, PANEL_IN, GRIPPER_IN, PANEL_IN]
    total = min(HEAD_IN + sum(heights), TALLEST_IN)
    figure = Figure(figsize=(WIDTH_IN, total))
    grid = GridSpec(
        len(heights), 1, figure, height_ratios=heights, hspace=0.12,
        left=0.1, right=0.86, top=1 - 0.6 / total, bottom=0.45 / total,
    )  # fmt: skip
    figure.suptitle(title(episode), x=0.1, y=1 - 0.12 / total, ha="left", va="top", fontsize=10)
    axes = [figure.add_subplot(grid[row]) for row in range(len(heights))]
    span = time_span(episode)
    for axis, (camera, kind) in zip(axes, strips, strict=False):
        _strip(axis, episode, camera, kind)
    force, torque, opening, action = axes[len(strips) :]
    _wrench(force, torque, episode)
    _opening(opening, episode)
    _action(action, episode)
    for panel in (force, torque, opening, action):
        _dress(panel, episode, span)
    _marks(force, episode)
    action.set_xlabel("time of the episode clock, s")
    for panel in (force, torque, opening):
        panel.tick_params(labelbottom=False)
    figure.align_ylabels([force, torque, opening, action])
    return figure


def title(episode: Episode) -> str:
    """Return the title of the picture: two lines on the task, success, label, source and wrench of the episode.

    Args:
        episode: Episode to describe.

    Raises:
        FormatError: If a recorded transform is unknown.
    """
    recorded_transforms(episode)
    meta = episode.meta
    steps = ", then ".join(map(_step_words, meta.transforms or [{"name": "tare"}]))
    label = ""
    if episode.has("label_offset") and episode.has("label_direction"):
        dx, dy = episode.label_offset * 1e3
        direction = int(episode.label_direction)
        known = DIRECTIONS[direction] if 0 <= direction < len(DIRECTIONS) else f"direction {direction}"
        label = f"; label (yellow arrow): {known}, ({dx:+.1f}, {dy:+.1f}) mm in base x, y"
    seconds = (episode.t_ns[-1] - episode.t_ns[0]) / 1e9
    lines = (
        f"{meta.task}, episode {meta.index}: {'success' if meta.success else 'no success'}{label}",
        f"{meta.source}, seed {meta.seed}, {len(episode)} steps, {seconds:.2f} s; "
        f"wrench in base axes, torque about the sensor origin, after {steps}",
    )
    return "\n".join(map(printable, lines))


def _step_words(record: dict[str, Any]) -> str:
    parameters = ", ".join(f"{key} {value}" for key, value in record.items() if key != "name")
    return f"{record['name']} ({parameters})" if parameters else str(record["name"])


def time_span(episode: Episode) -> tuple[float, float]:
    """Return the first and the last time of the observations and wrench readings of an episode, at least 1 ms apart.

    Args:
        episode: Episode with at least one observation.

    Returns:
        First and last time on the episode clock, [s].
    """
    times = np.concatenate([episode.t_ns, episode.wrench_t_ns]) / 1e9
    low, high = float(times.min()), float(times.max())
    return low, max(high, low + 1e-3)


def _strip(axis: Axes, episode: Episode, camera: Camera, kind: str) -> None:
    """Draw evenly chosen images in a row, from the first to the last, and the label into the last colour image."""
    images = camera.color if kind == "color" else camera.depth_m
    height, width = images.shape[1:3]
    axis.set_axis_off()
    box, figure = axis.get_position(), axis.get_figure(root=True)
    assert figure is not None
    figure_width, figure_height = figure.get_size_inches()
    room = box.width * figure_width / (PICTURE * box.height * figure_height * width / height)
    count = min(max(1, math.ceil(room)), FRAMES, len(images))  # as many as leave no gaps
    rows = np.linspace(0, len(images) - 1, count).round().astype(int)
    measured = images[images > 0] if kind == "depth" else images
    near, far = np.percentile(measured, [1, 99]) if kind == "depth" and measured.size else (0.0, 1.0)
    for column, row in enumerate(rows):
        inset = axis.inset_axes((column / len(rows), 0.0, 0.97 / len(rows), PICTURE))
        inset.set_axis_off()
        inset.imshow(images[row], cmap="viridis", vmin=near, vmax=far)
        inset.set_title(f"{camera.t_ns[row] / 1e9:.2f} s", fontsize=7, pad=2, color=GREY)
        if kind == "color" and row == rows[-1]:
            _label(inset, episode, camera)
    depth = f"depth, m:\ndark {near:.2f}\nbright {far:.2f}"
    words = f"{printable(camera.name, NAME)}\n{'colour' if kind == 'color' else depth}"
    axis.text(1.01, 0.45, words, transform=axis.transAxes, fontsize=8, va="center")


def _label(axis: Axes, episode: Episode, camera: Camera) -> None:
    """Draw an arrow from the TCP to the position to which the label says that it must move."""
    if not episode.has("label_offset"):
        return
    tcp = episode.proprio[-1, 1:4].astype(np.float64)
    goal = tcp + np.append(episode.label_offset, 0.0)
    points = np.stack([tcp, goal]) - camera.T_base_camera[:3, 3]
    rays = points @ camera.T_base_camera[:3, :3] @ camera.intrinsics.T
    if (rays[:, 2] <= 0).any():
        return
    start, end = rays[:, :2] / rays[:, 2:]
    arrow = {"arrowstyle": "-|>", "color": LABEL, "mutation_scale": 7, "shrinkA": 0, "shrinkB": 0}
    axis.annotate("", end, start, arrowprops=arrow, annotation_clip=True)


def _wrench(force: Axes, torque: Axes, episode: Episode) -> None:
    t = episode.wrench_t_ns / 1e9
    wrench = processed_wrench(episode)
    norm = np.linalg.norm(wrench[:, :3].astype(np.float64), axis=1)
    force.plot(t, norm, color="#bbbbbb", linewidth=2.4, label="|f|")
    _lines(force, t, wrench[:, :3], ("fx", "fy", "fz"))
    _lines(torque, t, wrench[:, 3:], ("mx", "my", "mz"))
    force.set_ylabel("force, N")
    torque.set_ylabel("torque, N m")


def _opening(axis: Axes, episode: Episode) -> None:
    if len(episode):
        _steps(axis, episode, episode.action[:, :1], ("commanded",), (TURN,))
    axis.plot(
        episode.t_ns / 1e9, episode.proprio[:, 0], color=GREY, marker=".", linestyle="", label="measured", clip_on=False
    )
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
    marks = _intervals(episode)
    names = sorted({name for name, _, _ in marks})
    for name, start, end in marks:
        axis.axvspan(start, end, color=MARKS[names.index(name) % len(MARKS)], alpha=0.35, linewidth=0)
    if axis.get_legend_handles_labels()[0]:
        axis.legend(loc="center left", bbox_to_anchor=(1.005, 0.5), fontsize=8, frameon=False)


def _intervals(episode: Episode) -> list[tuple[str, float, float]]:
    """Return name, start and end [s] of the annotations that have all three; ``svfl-data validate`` reports others."""
    return [
        (printable(one["name"], NAME), one["start_ns"] / 1e9, one["end_ns"] / 1e9)
        for one in episode.meta.annotations
        if isinstance(one, dict) and "name" in one
        if all(isinstance(one.get(key), int) for key in ("start_ns", "end_ns"))
    ]


def _marks(axis: Axes, episode: Episode) -> None:
    """Write the names of the annotations at the top of a panel, and mark the first observation at its bottom."""
    for name, begin, end in _intervals(episode):
        place = ((begin + end) / 2, 1)
        axis.annotate(name, place, xycoords=("data", "axes fraction"), ha="center", va="top", fontsize=7)
    start, (low, high) = float(episode.t_ns[0]) / 1e9, axis.get_xlim()
    side = "right" if start - low > (high - low) / 6 else "left"
    axis.annotate(
        " first observation ", (start, 0), xycoords=("data", "axes fraction"), fontsize=7, color=GREY, ha=side,
        va="bottom",
    )  # fmt: skip
