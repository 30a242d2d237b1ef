"""Findings: the results of checks of an episode, and helpers that put them into words."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from svfl_data.schema.episode import Episode

Severity = Literal["error", "warning", "note"]
"""How much a finding matters. An ``error`` means that the episode must not be used as it is, a ``warning`` that the
recording is probably not what was meant. A ``note`` only informs."""

SHOWN = 3  # largest number of places that one finding names


@dataclass(frozen=True)
class Finding:
    """One error or notable fact about one episode or a whole dataset.

    Attributes:
        episode: File of the episode, or name of the dataset if the finding concerns the whole dataset.
        field: Dataset path of the array, or name of the attribute, that the finding concerns; empty if it concerns the
            whole file.
        index: First row that the finding concerns; None if it concerns no row.
        severity: How much the finding matters: ``error``, ``warning`` or ``note``; see `Severity`.
        words: Description of what is wrong, with times and units.
    """

    episode: str
    field: str
    index: int | None
    severity: Severity
    words: str

    def __str__(self) -> str:
        place = self.field + ("" if self.index is None else f"[{self.index}]")
        return f"{self.severity}: {self.episode}: {place + ': ' if place else ''}{self.words}"


def error(episode: Episode, field: str, index: int | None, words: str) -> Finding:
    """Return a finding of severity ``error``, which makes the episode unfit for use.

    Args:
        episode: Episode that the finding is about.
        field: Dataset path of the array, or name of the attribute, that the finding concerns; empty for the whole file.
        index: First row that the finding concerns; None if it concerns no row.
        words: Description of what is wrong, with times and units.
    """
    return Finding(episode.name, field, index, "error", words)


def warning(episode: Episode, field: str, index: int | None, words: str) -> Finding:
    """Return a finding of severity ``warning``, for a recording that is probably not what was meant.

    Args:
        episode: Episode that the finding is about.
        field: Dataset path of the array, or name of the attribute, that the finding concerns; empty for the whole file.
        index: First row that the finding concerns; None if it concerns no row.
        words: Description of what is wrong, with times and units.
    """
    return Finding(episode.name, field, index, "warning", words)


def note(episode: Episode, field: str, index: int | None, words: str) -> Finding:
    """Return a finding of severity ``note``, which only informs.

    Args:
        episode: Episode that the finding is about.
        field: Dataset path of the array, or name of the attribute, that the finding concerns; empty for the whole file.
        index: First row that the finding concerns; None if it concerns no row.
        words: Description of what is wrong, with times and units.
    """
    return Finding(episode.name, field, index, "note", words)


def places(rows: np.ndarray, t_ns: np.ndarray) -> str:
    """Describe rows with their times, e.g. ``rows 7 (0.014 s), 9 (0.018 s) and 2 more``.

    Args:
        rows: Row numbers, shape (K,).
        t_ns: Time stamps of all rows of the stream, shape (M,), [ns].
    """
    named = ", ".join(f"{row} ({seconds(t_ns[row])})" for row in rows[:SHOWN])
    more = f" and {len(rows) - SHOWN} more" if len(rows) > SHOWN else ""
    return f"row{'s' if len(rows) > 1 else ''} {named}{more}"


def seconds(t_ns: int | np.integer) -> str:
    """Return a time of the episode clock, given in [ns], as a text in seconds."""
    return f"{t_ns / 1e9:.3f} s"


def longest_run(same: np.ndarray) -> tuple[int, int]:
    """Find the longest run of true values.

    Args:
        same: Truth values, shape (M,).

    Returns:
        First row and length of the longest run; (0, 0) if no value is true.
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], same, [False]]).astype(np.int8)))
    starts, lengths = edges[::2], edges[1::2] - edges[::2]
    if not len(starts):
        return 0, 0
    best = int(lengths.argmax())
    return int(starts[best]), int(lengths[best])


def travel_m(episode: Episode, start_ns: int, end_ns: int) -> float | None:
    """Return how far the TCP moves between two times: the largest extent of its path along a base axis, [m].

    Args:
        episode: Episode to look at.
        start_ns: Beginning of the interval on the episode clock, [ns].
        end_ns: End of the interval on the episode clock, [ns].

    Returns:
        The distance, or None if neither the proprioception nor the pose of the TCP was recorded.
    """
    if episode.has("proprio"):
        t_ns, position = episode.t_ns, episode.proprio[:, 1:4]
    elif episode.has("tcp_pose"):
        t_ns, position = episode.tcp_t_ns, episode.tcp_pose[:, :3]
    else:
        return None
    path = position[(t_ns >= start_ns) & (t_ns <= end_ns)]
    return float(np.ptp(path, axis=0).max()) if len(path) else 0.0
