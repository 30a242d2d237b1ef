"""Detection of contacts in the wrench stream, with hysteresis and debounce, as annotated intervals."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from svfl_data.errors import UsageError
from svfl_data.schema.episode import Episode
from svfl_data.signals.transforms import LowPass, processed_wrench

CONTACT = "contact"
"""Name of the annotation of a contact."""


@dataclass(frozen=True)
class ContactRule:
    """Rule that decides when a force is a contact.

    A wrist sensor also feels the inertia of the gripper. In simulated block centering, each 20 Hz action starts with a
    spike of tens of newtons that lasts 30 ms. The default threshold and duration (one action) exclude these spikes: in
    the first 60 centering episodes (seed 0) they find every final collision and 1 other interval, whereas 2 N and 20 ms
    find 390 others.

    Attributes:
        threshold_n: Force above which a contact begins, [N].
        release_n: Force below which a contact ends, [N]; at most the threshold.
        min_duration_s: Shortest duration of a contact, [s]. Shorter intervals are left out.
        cutoff_hz: Corner frequency of the low-pass filter on the force before its norm is taken, [Hz]; 0 means no
            filter.

    Example:
        >>> rule = ContactRule(threshold_n=5.0)
        >>> len(contact_intervals(dataset[0].wrench_t_ns, np.full(600, 9.0), rule))
        1
    """

    threshold_n: float = 5.0
    release_n: float = 2.5
    min_duration_s: float = 0.05
    cutoff_hz: float = 30.0

    def __post_init__(self) -> None:
        """Check that the parameters are possible, alone and together.

        Raises:
            UsageError: If a parameter is out of its range, or the release force exceeds the threshold.
        """
        if not 0 < self.release_n <= self.threshold_n < np.inf:
            raise UsageError(
                f"contact: needs 0 < release <= threshold, got release {self.release_n:g} N "
                f"and threshold {self.threshold_n:g} N"
            )
        if not (0 <= self.min_duration_s < np.inf and 0 <= self.cutoff_hz < np.inf):
            raise UsageError(
                f"contact: duration and corner frequency cannot be negative, got {self.min_duration_s:g} s "
                f"and {self.cutoff_hz:g} Hz"
            )


def contact_annotations(episode: Episode, rule: ContactRule | None = None) -> list[dict[str, Any]]:
    """Return the contacts of an episode as annotations.

    Args:
        episode: Episode in whose wrench stream contacts are searched. Its recorded transforms (by default the tare) are
            applied first.
        rule: Rule that decides when a force is a contact. None for the default `ContactRule`.

    Returns:
        Annotations in the order of their onsets: ``{"name": "contact", "start_ns", "end_ns", "by": {...}}``. The times
        are in ns of the episode clock, and ``by`` holds the tool and the rule.

    Raises:
        FormatError: If a recorded transform is unknown.
    """
    rule = rule or ContactRule()
    by = {"tool": "svfl-data relabel --contact", **asdict(rule)}
    return [
        {"name": CONTACT, "start_ns": start, "end_ns": end, "by": by}
        for start, end in contact_intervals(episode.wrench_t_ns, contact_force(episode, rule), rule)
    ]


def contact_force(episode: Episode, rule: ContactRule) -> np.ndarray:
    """Return the norm of the force of an episode, from which contacts are found.

    Args:
        episode: Episode whose wrench stream is read. Its recorded transforms are applied first.
        rule: Rule that gives the corner frequency of the low-pass filter.

    Returns:
        Norm of the processed, filtered force, shape (M,), float64, [N].

    Raises:
        FormatError: If a recorded transform is unknown.
    """
    filters = [LowPass(rule.cutoff_hz)] if rule.cutoff_hz else []
    return np.asarray(np.linalg.norm(processed_wrench(episode, filters)[:, :3].astype(np.float64), axis=1))


def contact_intervals(t_ns: np.ndarray, force: np.ndarray, rule: ContactRule) -> list[tuple[int, int]]:
    """Return the onset and offset times of the contacts in a force signal.

    Args:
        t_ns: Ascending time stamps of the readings, regular or not, shape (M,), [ns].
        force: Norm of the force, shape (M,), [N].
        rule: Rule that decides when a force is a contact.

    Returns:
        Disjoint intervals (onset, offset), ascending, [ns]. The onset is the time of the first reading above the
        threshold. The offset is the time of the first reading after it that is below the release force, or of the last
        reading if there is none.

    Example:
        >>> at, force = np.arange(100) * 2_000_000, np.where(np.arange(100) < 50, 0.0, 9.0)
        >>> contact_intervals(at, force, ContactRule())
        [(100000000, 198000000)]
    """
    shortest_ns = round(rule.min_duration_s * 1e9)
    rows = [(first, min(after, len(t_ns) - 1)) for first, after in _above(force, rule)]
    intervals = [(int(t_ns[first]), int(t_ns[last])) for first, last in rows]
    return [(start, end) for start, end in intervals if end > start and end - start >= shortest_ns]


def _above(force: np.ndarray, rule: ContactRule) -> list[tuple[int, int]]:
    """Return row ranges [first, after) that begin above the threshold and last until the force is below the release."""
    mark = np.where(force > rule.threshold_n, 1, np.where(force < rule.release_n, -1, 0))
    row = np.maximum.accumulate(np.where(mark != 0, np.arange(len(mark)), -1))  # the last reading that decides
    holds = (row >= 0) & (mark[row] == 1)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], holds, [False]]).astype(np.int8)))
    return [(int(first), int(after)) for first, after in edges.reshape(-1, 2)]
