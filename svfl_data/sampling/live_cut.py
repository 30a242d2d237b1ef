"""The cut of what a robot observes while it moves, with as much of the past as the cut needs."""

from typing import Any

import numpy as np

from svfl_data.errors import DatasetError
from svfl_data.sampling.batch import Batch
from svfl_data.sampling.cut import cut
from svfl_data.schema.clocks import Clock
from svfl_data.schema.declarations import STANDARD, Declarations
from svfl_data.schema.input_spec import InputSpec, Window
from svfl_data.schema.observation import Observation
from svfl_data.schema.rates import RATE_FACTOR

MEASURED_S = 1.0
"""Time after which the rate of a stream is compared with that of its window, [s]."""


class LiveCut:
    """Function that returns the values at each observation of a robot, as `cut` returns them for a recorded episode.

    Of each stream and camera it keeps as many rows as the inputs look back on. So a window is whole also where one
    observation carries fewer readings, once enough observations have been made since the episode began. Before that,
    the first reading is repeated, and ``padding`` is true. An observation that is not later than the one before begins
    another episode.

    Args:
        inputs: What is taken.
        declarations: Declarations of the robot's arrays.

    Example:
        >>> live = LiveCut(InputSpec(windows={"streams/wrench/wrench": Window(64)}, vectors=("observations/proprio",)))
        >>> times = {"streams/wrench/t_ns": np.arange(64) * 2_000_000}
        >>> seen = Observation(126_000_000, wrench=np.zeros((64, 6)), proprio=np.zeros(5), values=times)
        >>> sorted(live(seen))  # doctest: +ELLIPSIS
        ['observations/proprio', 'streams/wrench/age', ...]
    """

    def __init__(self, inputs: InputSpec, declarations: Declarations = STANDARD) -> None:
        self.inputs, self._declarations = inputs, declarations
        self._windows = inputs.groups | {f"cameras/{camera}": Window(inputs.frames) for camera in inputs.cameras}
        self.forget()

    def forget(self) -> None:
        """Forget the past, because another episode begins."""
        self._past: dict[str, dict[str, np.ndarray]] = {}
        self._counted: dict[str, tuple[int, int]] = {}  # time of the first row of a group, and number of rows
        self._now_ns: int | None = None

    def __call__(self, seen: Observation) -> Batch:
        """Return the values at an observation, each of shape (1, ...), by the keys of `cut`.

        Args:
            seen: Observation of the robot, later than the one before, or the first of an episode.

        Raises:
            FieldError: If the robot did not observe something that is taken.
            DatasetError: If a stream has been coming at less than half or more than twice the rate of its window, for a
                second or longer. A busy machine delays readings, so the rate of a single window says little.
        """
        if self._now_ns is not None and seen.t_ns <= self._now_ns:
            self.forget()
        self._now_ns = seen.t_ns
        arrays = dict(seen.arrays)
        for group, window in self._windows.items():
            if f"{group}/t_ns" in arrays:
                arrays |= self._with_past(group, window, arrays)
        return cut(
            arrays, self.inputs, np.array([seen.t_ns], np.int64), np.array([0]), self._clock, self._declarations,
            "observation",
        )  # fmt: skip

    def _clock(self, group: str) -> Clock:
        """Return the clock of a group as if it were declared, because its rate is checked as the rows arrive."""
        window = self._windows[group]
        return Clock() if window.resample else Clock(window.rate_hz)

    def _with_past(self, group: str, window: Window, arrays: dict[str, Any]) -> dict[str, np.ndarray]:
        """Return the arrays of a group with the rows of earlier observations before them, and keep them."""
        clock = f"{group}/t_ns"
        now = {path: np.asarray(rows) for path, rows in arrays.items() if path.startswith(f"{group}/")}
        now = {path: rows for path, rows in now.items() if rows.ndim and len(rows) == len(now[clock])}
        past = self._past.get(group)
        self._check_rate(group, window, now[clock], past[clock] if past else now[clock][:0])
        if past is not None:
            _fill_poses(group, now, past)
            new = now[clock] > past[clock][-1] if len(past[clock]) else np.ones(len(now[clock]), bool)
            now = {path: np.concatenate([past[path], rows[new]]) for path, rows in now.items() if path in past}
        first = max(0, len(now[clock]) - window.length)
        if window.resample and window.rate_hz and len(now[clock]):
            begin_ns = now[clock][-1] - int((window.length + 1) / window.rate_hz * 1e9)
            first = min(first, max(0, int(np.searchsorted(now[clock], begin_ns)) - 1))
        self._past[group] = {path: rows[first:].copy() for path, rows in now.items()}
        return now

    def _check_rate(self, group: str, window: Window, t_ns: np.ndarray, past_ns: np.ndarray) -> None:
        """Count the new rows of a group, and refuse a rate that differs by more than a busy machine explains.

        Args:
            group: Group of the rows.
            window: Window of the group.
            t_ns: Times of the rows of this observation, shape (M,), [ns].
            past_ns: Times of the rows that were kept of earlier ones, shape (K,), [ns].
        """
        if window.resample or window.rate_hz is None:
            return
        new = t_ns[t_ns > past_ns[-1]] if len(past_ns) else t_ns
        if not len(new):
            return
        first, count = self._counted.get(group, (int(new[0]), 0))
        self._counted[group] = first, count + len(new)
        elapsed = (int(new[-1]) - first) / 1e9
        if elapsed < MEASURED_S:
            return
        rate = (count + len(new) - 1) / elapsed
        if not 1 / RATE_FACTOR <= rate / window.rate_hz <= RATE_FACTOR:
            raise DatasetError(
                f"observation: {group} has {rate:.4g} Hz, but a window of {window.length} readings at "
                f"{window.rate_hz:.4g} Hz was asked for; the robot must give the rate that the policy learned from"
            )


def _fill_poses(group: str, now: dict[str, np.ndarray], past: dict[str, np.ndarray]) -> None:
    """Add NaN for the poses of a camera that are known only now, or were known only before."""
    path = f"{group}/T_base_camera_per_frame"
    for known, unknown in ((now, past), (past, now)):
        if path in known and path not in unknown:
            unknown[path] = np.full((len(unknown[f"{group}/t_ns"]), 4, 4), np.nan)
