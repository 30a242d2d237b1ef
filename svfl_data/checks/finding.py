"""What a check says about an episode."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from svfl_data.schema.episode import Episode

Severity = Literal["error", "warning", "note"]
"""error: do not use as it is; warning: probably not what was meant; note: good to know."""

SHOWN = 3  # places named in one finding


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong, or worth knowing, about one episode.

    Attributes:
        episode: File of the episode, or the dataset's name if it concerns the whole.
        field: Dataset path in the file, attribute, or empty if it concerns the whole file.
        index: First row concerned, None if it concerns no row.
        severity: How much it matters.
        words: What is wrong, in words, with times and units.
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
    """A finding that makes the episode unfit for use."""
    return Finding(episode.name, field, index, "error", words)


def warning(episode: Episode, field: str, index: int | None, words: str) -> Finding:
    """A finding that is probably not what was meant."""
    return Finding(episode.name, field, index, "warning", words)


def note(episode: Episode, field: str, index: int | None, words: str) -> Finding:
    """A finding that is good to know."""
    return Finding(episode.name, field, index, "note", words)


def places(rows: np.ndarray, t_ns: np.ndarray) -> str:
    """Rows with their times, e.g. ``rows 7 (0.014 s), 9 (0.018 s) and 2 more``."""
    named = ", ".join(f"{row} ({seconds(t_ns[row])})" for row in rows[:SHOWN])
    more = f" and {len(rows) - SHOWN} more" if len(rows) > SHOWN else ""
    return f"row{'s' if len(rows) > 1 else ''} {named}{more}"


def seconds(t_ns: int | np.integer) -> str:
    """A time of the episode clock, in words."""
    return f"{t_ns / 1e9:.3f} s"


def longest_run(same: np.ndarray) -> tuple[int, int]:
    """The longest run of true values.

    Args:
        same: Truth values, shape (M,).

    Returns:
        Its first row and its length; (0, 0) if there is none.
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], same, [False]]).astype(np.int8)))
    starts, lengths = edges[::2], edges[1::2] - edges[::2]
    if not len(starts):
        return 0, 0
    best = int(lengths.argmax())
    return int(starts[best]), int(lengths[best])


def travel_m(episode: Episode, start_ns: int, end_ns: int) -> float:
    """How far the TCP moves between two times, largest extent along an axis, [m]."""
    within = (episode.t_ns >= start_ns) & (episode.t_ns <= end_ns)
    path = episode.proprio[within, 1:4]
    return float(np.ptp(path, axis=0).max()) if len(path) else 0.0
