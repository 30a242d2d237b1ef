"""The wrenches of an episode: curves, arrows, annotations and the coloured path of the TCP, in one pass."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import rerun as rr

from svfl_data.schema.field_words import wrench_groups
from svfl_data.signals.camera_poses import TCP_TIMES
from svfl_data.signals.contact import CONTACT, ContactRule, contact_intervals
from svfl_data.symmetry import DIRECTIONS
from svfl_data.viewer.entities import plots, scene
from svfl_data.viewer.entities.episode_source import PROPRIO, TIMES, WRENCH, WRENCH_TIMES, EpisodeSource
from svfl_data.viewer.entities.names import SCENE

ARROWS = 20_000
"""Largest number of readings that are all drawn as arrows; of more readings, only the latest at each observation is."""
RULE = ContactRule()


@dataclass(frozen=True, eq=False)
class Loads:
    """Ranges and annotations of an episode that are found while its wrench is logged.

    Attributes:
        low: Smallest value of each component of the processed wrench, at most 0, shape (6,), [N] and [N m].
        high: Largest value of each component of the processed wrench, at least 0, shape (6,), [N] and [N m].
        peak: Largest norm of the filtered force, [N].
        annotations: Recorded annotations, contacts found here, and the label as an annotation.
    """

    low: np.ndarray
    high: np.ndarray
    peak: float
    annotations: tuple[dict, ...]


def log_wrenches(recording: rr.RecordingStream, shown: EpisodeSource) -> Loads:
    """Log ``streams/wrench``, the arrows of further wrenches in base axes, the annotations and the path of the TCP.

    Args:
        recording: Recording to log to.
        shown: Episode that is shown; it may lack every one of these.
    """
    t_ns, root = shown[TIMES], shown.root
    clock = shown[WRENCH_TIMES] if WRENCH in shown else np.empty(0, np.int64)
    at_steps = np.searchsorted(clock, t_ns, side="right") - 1  # the latest reading of each observation
    chosen = _arrow_rows(shown, clock)
    size = np.zeros(len(clock), np.float32)
    low, high, first = np.zeros(6), np.zeros(6), 0
    for piece in shown.readings(RULE):
        plots.send_wrench(recording, root, piece)
        after = first + len(piece.t_ns)
        size[first:after] = piece.size
        low, high = np.minimum(low, piece.wrench.min(axis=0)), np.maximum(high, piece.wrench.max(axis=0))
        rows = chosen[(chosen >= first) & (chosen < after)] - first
        scene.send_arrows(recording, root, piece.t_ns[rows], piece.wrench[rows])
        recording.flush()
        first = after
    annotations = _annotations(shown, clock, size, t_ns)
    plots.send_marks(recording, root, annotations, level=float(low[:3].min() - 0.05 * np.ptp([low[:3], high[:3]])))
    peak = float(size.max(initial=0.0))
    if (way := shown.positions()) and (len(clock) or PROPRIO not in shown):
        since, positions = way
        force = _force_on_the_way(at_steps[since:], size) if len(clock) else np.zeros(max(0, len(positions) - 1))
        scene.log_path(recording, root, positions, force, peak)
    _log_further_arrows(recording, shown)
    return Loads(low, high, peak, tuple(annotations))


def _arrow_rows(shown: EpisodeSource, clock: np.ndarray) -> np.ndarray:
    """Return the readings that are drawn as arrows: those for which it is known where the wrist is."""
    t_ns = shown[TIMES]
    if (since := _wrist_since_ns(shown)) is None:
        return np.empty(0, np.int64)
    at_steps = np.searchsorted(clock, t_ns, side="right") - 1
    chosen = np.arange(len(clock)) if len(clock) <= ARROWS else np.unique(at_steps[at_steps >= 0])
    return chosen[clock[chosen] >= since] if len(chosen) else chosen


def _wrist_since_ns(shown: EpisodeSource) -> int | None:
    """Return from when on it is known where the wrist is, [ns]; None if it is not known at all."""
    clock = shown[TIMES] if PROPRIO in shown else shown[TCP_TIMES] if TCP_TIMES in shown else np.empty(0, np.int64)
    return int(clock[0]) if len(clock) else None


def _log_further_arrows(recording: rr.RecordingStream, shown: EpisodeSource) -> None:
    """Log the arrows of the other wrench sensors whose axes are those of the base, tared if they have a tare."""
    for group in wrench_groups(shown.arrays, shown.declarations):
        field, path = shown.declarations.at(f"{group}/wrench"), f"{group}/wrench"
        if path == WRENCH or field is None or field.axes != "base":
            continue
        rows = _arrow_rows(shown, clock := shown[f"{group}/t_ns"])
        if len(rows):
            offset = shown[f"{group}/tare"] if f"{group}/tare" in shown else np.zeros(6)
            place = f"wrist/{rr.escape_entity_path_part(group)}"
            scene.log_arrow_style(recording, f"{shown.root}{SCENE}/{place}")
            wrench = shown[path][rows].astype(np.float64) - offset
            scene.send_arrows(recording, shown.root, clock[rows], wrench, place)


def _force_on_the_way(at_steps: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Return the largest force between each observation and the next, shape (N,), [N]."""
    edges = np.maximum(at_steps, 0)
    return np.array([size[first : max(after, first + 1)].max(initial=0.0) for first, after in pairwise(edges)])


def _annotations(shown: EpisodeSource, clock: np.ndarray, size: np.ndarray, t_ns: np.ndarray) -> list[dict]:
    """Return the recorded intervals, contacts found here if none were recorded, and the label at the last step."""
    found = [
        one
        for one in shown.meta.annotations
        if isinstance(one, dict) and "name" in one
        if all(isinstance(one.get(key), int) for key in ("start_ns", "end_ns"))
    ]
    if not any(one["name"] == CONTACT for one in found):
        spans = contact_intervals(clock, size, RULE)
        found += [{"name": CONTACT, "start_ns": start, "end_ns": end} for start, end in spans]
    if "labels/direction" in shown and len(t_ns) > 1:
        name = f"label: {DIRECTIONS[int(shown['labels/direction'])]}"
        found.append({"name": name, "start_ns": int(t_ns[-2]), "end_ns": int(t_ns[-1])})
    return found
