"""Curves over time: wrench at its native rate, marks, proprioception, action commanded and achieved, reward."""

from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import Any

import numpy as np
import rerun as rr

from svfl_data.system.printable import printable
from svfl_data.viewer import names
from svfl_data.viewer.episode_source import Readings
from svfl_data.viewer.names import AXES, FORCE, LABEL, PALE_AXES, TORQUE, WHITE, send

FORCES, TORQUES = ("fx, N", "fy, N", "fz, N"), ("mx, N m", "my, N m", "mz, N m")
MARK_COLORS = ((86, 180, 233), LABEL, TORQUE, (0, 158, 115), FORCE)
"""Of the names of annotations, in their order; contact is the first."""
FIRST = ("contact",)
MOST_NAMES = 100
OTHERS = "other annotations"


def log_styles(recording: rr.RecordingStream, root: str) -> None:
    """Log names, colours and widths of all curves."""
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
        recording.log(root + path, rr.SeriesLines(names=labels, colors=colors, widths=width, **rest), static=True)


def send_curve(recording: rr.RecordingStream, path: str, t_ns: np.ndarray, values: np.ndarray) -> None:
    """Log rows of a curve, or of several with one column each, shape (N, C)."""
    send(recording, path, t_ns, rr.Scalars.columns(scalars=np.asarray(values, dtype=np.float64)))


def send_wrench(recording: rr.RecordingStream, root: str, readings: Readings) -> None:
    """Log a piece of the wrench stream: raw, processed, and once more to mark the window of the current step."""
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
    """Log proprioception, shape (N, 5)."""
    send_curve(recording, root + names.POSITION, t_ns, proprio[:, 1:4])
    send_curve(recording, root + names.OPENING_AND_YAW, t_ns, proprio[:, [0, 4]])


def send_actions(
    recording: rr.RecordingStream, root: str, t_ns: np.ndarray, action: np.ndarray, proprio: np.ndarray
) -> None:
    """Log what was commanded, and what had come of it at the next observation.

    Args:
        recording: Where.
        root: Folder of the episode's entities.
        t_ns: Of the observation before each action, shape (N,), [ns].
        action: Shape (N, 5).
        proprio: From the first of these observations to the one after the last action, shape (N+1, 5).
    """
    moved = np.diff(proprio, axis=0)
    turned = np.angle(np.exp(1j * moved[:, 4:]))  # the yaw may have gone round
    for path, values in (
        (names.COMMANDED, action[:, 1:4]),
        (names.ACHIEVED, moved[:, 1:4]),
        (names.COMMANDED + "_turn", action[:, 4:]),
        (names.ACHIEVED + "_turn", turned),
        (names.COMMANDED + "_opening", action[:, :1]),
        (names.ACHIEVED + "_opening", proprio[1:, :1]),
    ):
        send_curve(recording, root + path, t_ns, values)


def send_reward(recording: rr.RecordingStream, root: str, t_ns: np.ndarray, success: bool) -> None:
    """Log the sparse reward: 1 for the action that achieved the task, with which the episode ends, and 0 before.

    Args:
        recording: Where.
        root: Folder of the episode's entities.
        t_ns: Of every observation, shape (N+1,), [ns].
        success: Whether the task was achieved.
    """
    values = np.zeros((len(t_ns), 2))
    values[-2:-1, 0] = success  # of the last action
    values[-1, 1] = success
    send_curve(recording, root + names.REWARD, t_ns, values)


def marks_by_name(annotations: Sequence[Mapping[str, Any]]) -> dict[str, list[tuple[int, int]]]:
    """Start and end of the annotated intervals, [ns], by name: contacts first, at most `MOST_NAMES` names.

    A viewer with thousands of curves ends, and nobody could tell them apart: names beyond these are one, `OTHERS`.
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
    """Log named intervals as bars.

    Args:
        recording: Where.
        root: Folder of the episode's entities.
        annotations: With name, start_ns and end_ns.
        level: At which height of the force plot, [N].
    """
    marks = marks_by_name(annotations)
    colors = dict(zip(dict.fromkeys([*FIRST, *marks]), cycle(MARK_COLORS), strict=False))
    for name, spans in marks.items():
        t_ns = np.array([(start, max(start, end - 1), end) for start, end in spans]).reshape(-1)
        values = np.tile([level, level, np.nan], len(spans))  # NaN lifts the pen
        path = f"{root}{names.MARKS}/{rr.escape_entity_path_part(name)}"
        recording.log(path, rr.SeriesLines(names=[printable(name)], colors=[colors[name]], widths=7.0), static=True)
        send_curve(recording, path, t_ns, values[:, None])
