"""Checks that the time stamps of an episode are plausible, of each stream alone and compared with the observations."""

from collections.abc import Iterator

import numpy as np

from svfl_data.checks.finding import SHOWN, Finding, error, note, places, seconds, warning
from svfl_data.schema.clocks import declared_gaps, mean_hz, without_gaps
from svfl_data.schema.episode import Episode
from svfl_data.schema.rates import declared_hz, rate_fault, rate_words

GAP = 1.5  # a reading is missing in an interval that is longer than so many periods
REGULAR = 0.25  # 9 of 10 intervals of a regular stream differ from the period by at most this share of the period
IRREGULAR_GAP = 4.0  # a gap in an irregular stream is longer than so many times the 90th percentile of its intervals
JITTER = 0.1  # a warning is given if intervals vary by more than this share of the period
BEHIND = 3  # the clock was set back if so many readings in a row lie behind; fewer readings are out of order
MISSING = 0.01  # a warning is given if more than this share of the readings is missing
CLOCK_START_S = 3600.0  # an episode clock starts with the episode; a later first observation means another clock


def clocks(episode: Episode) -> dict[str, np.ndarray]:
    """Return the time stamps of the observations and of every declared stream and camera, [ns], by dataset path."""
    return {
        path: array
        for path, array in episode.arrays.items()
        if path.endswith("/t_ns") and episode.declarations.at(path)
    }


def sampled(episode: Episode) -> dict[str, np.ndarray]:
    """Return the time stamps, [ns], of all streams but those of events: texts come when something happens."""
    texts, numbers = set[str](), set[str]()
    for path, array in episode.arrays.items():
        if not path.endswith("/t_ns"):
            (texts if array.dtype.kind == "S" and path.startswith("streams/") else numbers).add(_group(path))
    return {path: t_ns for path, t_ns in clocks(episode).items() if _group(path) not in texts - numbers}


def period_ns(t_ns: np.ndarray) -> float:
    """Return the median of the positive intervals between time stamps, [ns]; 0 if there is no such interval."""
    forward = np.diff(t_ns)
    forward = forward[forward > 0]
    return float(np.median(forward)) if len(forward) else 0.0


def expected_ns(episode: Episode, path: str) -> float:
    """Return the period that a stream should have, [ns].

    Args:
        episode: Episode to which the stream belongs.
        path: Dataset path of the stream's time stamps.

    Returns:
        The declared period or, if none was declared, the median interval; 0 if there is neither.
    """
    declared = declared_hz(episode.meta.config, _group(path))
    return 1e9 / declared if declared else period_ns(episode.arrays[path])


def _group(path: str) -> str:
    return path.rpartition("/")[0]


def check_rates(episode: Episode) -> Iterator[Finding]:
    """Check that time stamps are nanoseconds, and that streams have the rates that were declared for them."""
    for path, t_ns in clocks(episode).items():
        group = _group(path)
        found = without_gaps(t_ns, declared_gaps(episode.meta.annotations, group))
        declared = declared_hz(episode.meta.config, group)
        if words := rate_words(group, found, declared):
            yield error(episode, path, None, words)
        elif fault := rate_fault(found, declared):
            yield warning(episode, path, None, fault[1])


def check_order(episode: Episode) -> Iterator[Finding]:
    """Check that time stamps ascend: none is repeated, none lies before an earlier one, and no clock is set back."""
    for path, t_ns in clocks(episode).items():
        intervals = np.diff(t_ns)
        repeated = np.flatnonzero(intervals == 0) + 1
        if len(repeated):
            yield error(episode, path, int(repeated[0]), f"duplicate timestamps at {places(repeated, t_ns)}")
        back = np.flatnonzero(intervals < 0) + 1
        set_back = np.array([_set_back(t_ns, int(row)) for row in back], dtype=np.bool_)
        for row in back[set_back][:SHOWN]:
            jump = (t_ns[row] - t_ns[row - 1] - period_ns(t_ns)) / 1e6
            words = f"stepped clock: set by {jump:+.1f} ms at {places(np.array([row]), t_ns)}"
            yield error(episode, path, int(row), words)
        if len(backward := back[~set_back]):
            words = f"backward timestamps (out of order) at {places(backward, t_ns)}"
            yield error(episode, path, int(backward[0]), words)


def _set_back(t_ns: np.ndarray, row: int) -> bool:
    """Return whether at least `BEHIND` readings in a row, from `row` on, do not lie after the reading before `row`."""
    after = t_ns[row : row + BEHIND]
    return len(after) == BEHIND and bool((after <= t_ns[row - 1]).all())


def check_gaps(episode: Episode) -> Iterator[Finding]:
    """Check that no reading is missing, and that no clock is set forward.

    A wide interval counts as a clock that was set forward if the stream ends after all others by about as much.
    """
    every = sampled(episode)
    for path, t_ns in every.items():
        intervals, period = np.diff(t_ns), expected_ns(episode, path)
        if not period or not len(intervals):
            continue
        limit = GAP * period if _regular(t_ns) else max(GAP * period, IRREGULAR_GAP * np.percentile(intervals, 90))
        wide = np.flatnonzero((intervals > limit) & ~_declared(episode, path)) + 1
        stepped = np.array([_ends_late(path, intervals[row - 1] - period, every) for row in wide], dtype=np.bool_)
        for row in wide[stepped][:SHOWN]:
            jump = (intervals[row - 1] - period) / 1e6
            words = f"stepped clock: set by {jump:+.1f} ms at {places(np.array([row]), t_ns)}"
            yield error(episode, path, int(row), words)
        if len(gaps := wide[~stepped]):
            widest = int(intervals[gaps - 1].max())
            words = (
                f"gaps before {places(gaps, t_ns)}; the widest is {widest / 1e6:.1f} ms, "
                f"{widest / period:.1f} periods of {period / 1e6:.3g} ms"
            )
            yield warning(episode, path, int(gaps[0]), words)


def _declared(episode: Episode, path: str) -> np.ndarray:
    """Return which intervals of a stream overlap a gap that was declared when recording, shape (M - 1,), bool."""
    t_ns = episode.arrays[path]
    known = np.zeros(len(t_ns) - 1, dtype=np.bool_)
    for start, end in declared_gaps(episode.meta.annotations, _group(path)):
        known |= (t_ns[:-1] < end) & (start < t_ns[1:])
    return known


def _regular(t_ns: np.ndarray) -> bool:
    return _spread(t_ns) <= REGULAR


def _spread(t_ns: np.ndarray) -> float:
    """Return the 90th percentile of the deviation of positive intervals from the period, in periods."""
    intervals, period = np.diff(t_ns), period_ns(t_ns)
    intervals = intervals[intervals > 0]
    return float(np.percentile(np.abs(intervals - period), 90) / period) if len(intervals) else 0.0


def _ends_late(path: str, excess: float, every: dict[str, np.ndarray]) -> bool:
    """Return whether a stream ends after all others by about `excess` [ns], that of one interval over the period."""
    others = [t_ns for other, t_ns in every.items() if other != path and len(t_ns)]
    if not others:
        return False
    late = float(every[path][-1]) - max(float(t_ns[-1]) for t_ns in others)
    return late > max(excess / 2, *map(period_ns, others))


def check_jitter(episode: Episode) -> Iterator[Finding]:
    """Check that the intervals of a stream are about equal, and that mean and median interval give the same rate."""
    for path, t_ns in sampled(episode).items():
        intervals, period, spread = np.diff(t_ns), period_ns(t_ns), _spread(t_ns)
        if spread > JITTER:
            row = int(np.abs(intervals - period).argmax()) + 1
            words = (
                f"jitter: intervals vary by {spread:.0%} of the period of {period / 1e6:.3g} ms; "
                f"the oddest is {intervals[row - 1] / 1e6:.3g} ms before {places(np.array([row]), t_ns)}"
            )
            yield warning(episode, path, row, words)
        if not period or spread > REGULAR:
            continue
        known = float(intervals[_declared(episode, path)].sum())
        missing = round((float(t_ns[-1]) - float(t_ns[0]) - known) / period) - len(intervals)
        if missing > max(1, MISSING * len(t_ns)):
            words = (
                f"drop-outs: about {missing} of {len(t_ns) + missing} readings are missing "
                f"({mean_hz(t_ns):.1f} Hz by mean interval, {1e9 / period:.1f} Hz by median)"
            )
            yield warning(episode, path, None, words)


def check_coverage(episode: Episode) -> Iterator[Finding]:
    """Check that streams share the episode clock and last from the first observation, or earlier, to the last one."""
    start, end = int(episode.t_ns[0]), int(episode.t_ns[-1])
    if start < 0 or start > CLOCK_START_S * 1e9:
        words = f"the clock does not start with the episode: the first observation is at {seconds(start)}"
        yield warning(episode, "observations/t_ns", 0, words)
    for path, t_ns in sampled(episode).items():
        if not len(t_ns):
            yield warning(episode, path, None, "the stream is empty")
            continue
        if t_ns[0] > start:
            words = f"nothing at or before the first observation ({seconds(start)}): starts at {seconds(t_ns[0])}"
            yield warning(episode, path, 0, words)
        dropped = any(start <= end <= after for start, after in declared_gaps(episode.meta.annotations, _group(path)))
        if t_ns[-1] < end - 2 * max(expected_ns(episode, path), period_ns(episode.t_ns)) and not dropped:
            words = f"ends at {seconds(t_ns[-1])}, the last observation is at {seconds(end)}"
            yield warning(episode, path, len(t_ns) - 1, words)
    if not len(episode):
        yield note(episode, "actions", None, "the episode has no actions")
