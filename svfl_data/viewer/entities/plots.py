"""Curves over time: wrench at its native rate, annotations, proprioception, commanded and achieved action, reward."""

from collections.abc import Container, Mapping, Sequence
from itertools import cycle
from typing import Any

import numpy as np
import rerun as rr

from svfl_data.system.printable import printable
from svfl_data.viewer.entities import names
from svfl_data.viewer.entities.episode_source import Readings
from svfl_data.viewer.entities.names import AXES, FORCE, LABEL, PALE_AXES, TORQUE, WHITE, send

FORCES, TORQUES = ("fx, N", "fy, N", "fz, N"), ("mx, N m", "my, N m", "mz, N m")
MARK_COLORS = ((86, 180, 233), LABEL, TORQUE, (0, 158, 115), FORCE)
"""Colours of the annotations by name, in the order of the names; contact has the first colour."""
FIRST = ("contact",)
MOST_NAMES = 100
OTHERS = "other annotations"


PARTS = ("wrench", "motion", "proprio", "reward")
"""Parts of an episode whose curves have fixed names."""


def log_styles(recording: rr.RecordingStream, root: str, parts: Container[str] = PARTS) -> None:
    """Log the names, colours and widths of all curves.

    Args:
        recording: Recording to log to.
        root: Prefix of the episode's entities.
        parts: The parts of `PARTS` that the episode has.
    """
    held = {"interpolation_mode": "StepAfter"}
    styles: dict[str, tuple[Sequence[str], Sequence[tuple[int, int, int]], float, Mapping[str, Any]]] = {
        names.FORCE_PLOT: (FORCES, AXES, 1.5, {}),
        names.TORQUE_PLOT: (TORQUES, AXES, 1.5, {}),
        names.RAW_FORCE: ([f"raw {name}" for name in FORCES], AXES, 1.5, {}),
        names.RAW_TORQUE: ([f"raw {name}" for name in TORQUES], AXES, 1.5, {}),
        names.WINDOW_FORCE: ([f"window {name}" for name in FORCES], AXES, 4.0, {}),
        names.WINDOW_TORQUE: ([f"window {name}" for name in TORQUES], AXES, 4.0, {}),
        names.SIZE: (["|f| filtered, N"], [FORCE], 1.5, {}),
        names.COMMANDED: (["dx, m", "dy, m", "dz, m"], AXES, 2.5, held),
        names.ACHIEVED: (["dx achieved", "dy achieved", "dz achieved"], PALE_AXES, 1.0, held),
        names.COMMANDED + "_turn": (["dtheta, rad"], [TORQUE], 2.5, held),
        names.ACHIEVED + "_turn": (["dtheta achieved"], [WHITE], 1.0, held),
        names.COMMANDED + "_opening": (["opening, 0 to 1"], [FORCE], 2.5, held),
        names.ACHIEVED + "_opening": (["opening achieved"], [WHITE], 1.0, held),
        names.POSITION: (["x, m", "y, m", "z, m"], AXES, 1.5, {}),
        names.OPENING_AND_YAW: (["opening, 0 to 1", "theta, rad"], (FORCE, TORQUE), 1.5, {}),
        names.REWARD: (["reward", "success"], (FORCE, AXES[1]), 2.5, held),
    }
    for path, (labels, colors, width, rest) in styles.items():
        if path.partition("/")[0] in parts:
            recording.log(root + path, rr.SeriesLines(names=labels, colors=colors, widths=width, **rest), static=True)


def send_curve(recording: rr.RecordingStream, path: str, t_ns: np.ndarray, values: np.ndarray) -> None:
    """Log rows of one or more curves.

    Args:
        recording: Recording to log to.
        path: Entity of the curves.
        t_ns: Timestamps of the rows, shape (N,), [ns].
        values: Values with one column for each curve, shape (N, C).
    """
    send(recording, path, t_ns, rr.Scalars.columns(scalars=np.asarray(values, dtype=np.float64)))


def send_wrench(recording: rr.RecordingStream, root: str, readings: Readings) -> None:
    """Log a piece of the wrench stream: raw, processed, and processed again to highlight the current wrench window.

    Args:
        recording: Recording to log to.
        root: Prefix of the episode's entities.
        readings: Piece of the wrench stream.
    """
    t_ns = readings.t_ns
    for path, values in (
        (names.FORCE_PLOT, readings.wrench[:, :3]),
        (names.TORQUE_PLOT, readings.wrench[:, 3:]),
        (names.WINDOW_FORCE, readings.wrench[:, :3]),
        (names.WINDOW_TORQUE, readings.wrench[:, 3:]),
        (names.RAW_FORCE, readings.raw[:, :3]),
        (names.RAW_TORQUE, readings.raw[:, 3:]),
        (names.SIZE, readings.size[:, None]),
    ):
        send_curve(recording, root + path, t_ns, values)


def send_proprio(recording: rr.RecordingStream, root: str, t_ns: np.ndarray, proprio: np.ndarray) -> None:
    """Log the TCP position, the gripper opening and the yaw.

    Args:
        recording: Recording to log to.
        root: Prefix of the episode's entities.
        t_ns: Timestamps of the observations, shape (N,), [ns].
        proprio: Proprioception at each observation, shape (N, 5).
    """
    send_curve(recording, root + names.POSITION, t_ns, proprio[:, 1:4])
    send_curve(recording, root + names.OPENING_AND_YAW, t_ns, proprio[:, [0, 4]])


def send_actions(
    recording: rr.RecordingStream, root: str, t_ns: np.ndarray, action: np.ndarray, proprio: np.ndarray | None
) -> None:
    """Log the commanded planar actions, and the movement and gripper opening achieved at the next observation.

    Args:
        recording: Recording to log to.
        root: Prefix of the episode's entities.
        t_ns: Timestamps of the observation before each action, shape (N,), [ns].
        action: Commanded actions, shape (N, 5).
        proprio: Proprioception at these observations and at the observation after the last action, shape (N+1, 5). None
            if it was not recorded.
    """
    for path, values in (
        (names.COMMANDED, action[:, 1:4]),
        (names.COMMANDED + "_turn", action[:, 4:]),
        (names.COMMANDED + "_opening", action[:, :1]),
    ):
        send_curve(recording, root + path, t_ns, values)
    if proprio is None:
        return
    moved = np.diff(proprio, axis=0)
    turned = np.angle(np.exp(1j * moved[:, 4:]))  # into -pi..pi, because the yaw may jump by a full turn
    for path, values in (
        (names.ACHIEVED, moved[:, 1:4]),
        (names.ACHIEVED + "_turn", turned),
        (names.ACHIEVED + "_opening", proprio[1:, :1]),
    ):
        send_curve(recording, root + path, t_ns, values)


def send_reward(recording: rr.RecordingStream, root: str, t_ns: np.ndarray, success: bool) -> None:
    """Log the sparse reward, which is 1 for the last action of a successful episode and otherwise 0, and the success.

    Args:
        recording: Recording to log to.
        root: Prefix of the episode's entities.
        t_ns: Timestamps of all observations, shape (N+1,), [ns].
        success: Whether the task was achieved.
    """
    values = np.zeros((len(t_ns), 2))
    values[-2:-1, 0] = success  # reward of the last action, at the observation before it
    values[-1, 1] = success
    send_curve(recording, root + names.REWARD, t_ns, values)


def marks_by_name(annotations: Sequence[Mapping[str, Any]]) -> dict[str, list[tuple[int, int]]]:
    """Group annotated intervals by name: contacts first, then the other names in alphabetical order.

    Only the first `MOST_NAMES` names get a group of their own; the intervals of further names are grouped as `OTHERS`.
    With thousands of curves the viewer terminates, and a person could not distinguish them.

    Args:
        annotations: Annotations, each with ``name``, ``start_ns`` and ``end_ns``.

    Returns:
        Start and end of the intervals, [ns], by name.
    """
    found: dict[str, list[tuple[int, int]]] = {}
    for one in annotations:
        found.setdefault(str(one["name"]), []).append((one["start_ns"], one["end_ns"]))
    ordered = [*FIRST, *sorted(found.keys() - set(FIRST))]
    marks = {name: found[name] for name in ordered[:MOST_NAMES] if name in found}
    if rest := [span for name in ordered[MOST_NAMES:] for span in found[name]]:
        marks[OTHERS] = sorted(rest)
    return marks


def send_marks(
    recording: rr.RecordingStream, root: str, annotations: Sequence[Mapping[str, Any]], level: float
) -> None:
    """Log annotated intervals as horizontal bars in the force plot.

    Args:
        recording: Recording to log to.
        root: Prefix of the episode's entities.
        annotations: Annotations, each with ``name``, ``start_ns`` and ``end_ns``.
        level: Force at which the bars are drawn, [N].
    """
    marks = marks_by_name(annotations)
    colors = dict(zip(dict.fromkeys([*FIRST, *marks]), cycle(MARK_COLORS), strict=False))
    for name, spans in marks.items():
        t_ns = np.array([(start, max(start, end - 1), end) for start, end in spans]).reshape(-1)
        values = np.tile([level, level, np.nan], len(spans))  # NaN interrupts the curve between two intervals
        path = f"{root}{names.MARKS}/{rr.escape_entity_path_part(name)}"
        recording.log(path, rr.SeriesLines(names=[printable(name)], colors=[colors[name]], widths=7.0), static=True)
        send_curve(recording, path, t_ns, values[:, None])
