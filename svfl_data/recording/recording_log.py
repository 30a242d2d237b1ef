"""Log of a recording until it is sealed: its clocks, its declared gaps, and its faults."""

from collections.abc import Callable
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from svfl_data.errors import FieldError
from svfl_data.recording.recording_clocks import Clock, Gap, Late, clock_faults
from svfl_data.schema.episode import Meta
from svfl_data.schema.rates import declared_rates

TOOL = "EpisodeWriter"
FAULTS = 100
"""Largest number of faults of an episode that are kept in words. Further faults are only counted."""
OBSERVATIONS = "observations"


class RecordingLog:
    """Log of one episode. Callers that use the log from several threads must hold a lock.

    Args:
        note: Function that puts a record without rows into the episode's journal, so that repair can read the record.
    """

    def __init__(self, note: Callable[[dict[str, Any]], None]) -> None:
        self._note = note
        self._clocks: dict[str, Clock] = {}
        self._gaps: list[Gap] = []
        self._faults: list[str] = []
        self._beyond = 0

    @property
    def faults(self) -> list[str]:
        """Faults of the recording so far, in words."""
        return [*self._faults, *([f"and {self._beyond} more"] if self._beyond else [])]

    def newer(self, group: str, t_ns: np.ndarray, late: Late) -> np.ndarray | None:
        """Return which rows of a group may be appended; see `svfl_data.recording.recording_clocks.Clock.newer`.

        Args:
            group: Group to which the rows are to be appended, such as ``streams/wrench``.
            t_ns: Time stamps of the rows, shape (M,), [ns].
            late: What to do with rows that are not newer than all before them: ``refuse`` raises an error, ``drop``
                leaves these rows out.

        Returns:
            Whether each row may be appended, shape (M,), bool. None means all rows.

        Raises:
            FieldError: If a row is not newer and `late` is ``refuse``.
        """
        return self._clocks.setdefault(group, Clock()).newer(group, t_ns, late)

    def take(self, group: str, t_ns: np.ndarray, dropped: int) -> None:
        """Count the rows of a group that were appended and those that were left out; a reading ends an open gap.

        Args:
            group: Group to which the rows were appended, such as ``streams/wrench``.
            t_ns: Time stamps of the rows that were appended, shape (M,), [ns].
            dropped: Number of rows that were left out because they came too late.
        """
        self._clocks[group].take(t_ns)
        self._clocks[group].dropped += dropped
        for row, gap in enumerate(self._gaps if len(t_ns) else ()):
            if gap.stream == group and gap.end_ns is None and t_ns[0] >= gap.start_ns:
                self._gaps[row] = replace(gap, end_ns=int(t_ns[0]))
                self._note({"gap": asdict(self._gaps[row])})

    def declare(self, gap: Gap) -> None:
        """Keep a declared gap, unless it has no end and the same stream already has an open gap without an end."""
        if gap.end_ns is None and any(known.stream == gap.stream and known.end_ns is None for known in self._gaps):
            return
        self._gaps.append(gap)
        self._note({"gap": asdict(gap)})

    def mark(self, group: str, t_ns: np.ndarray | None, words: str) -> None:
        """Keep the fault that an append was refused.

        Args:
            group: Group to which the rows were to be appended, such as ``streams/wrench``.
            t_ns: Time stamps of the refused rows, [ns]; None if the rows had none.
            words: Reason for the refusal.
        """
        if len(self._faults) == FAULTS:
            self._beyond += 1
            return
        when = f" at {t_ns.flat[0] / 1e9:.3f} s" if t_ns is not None and t_ns.size and t_ns.dtype.kind in "iu" else ""
        self._faults.append(f"readings of {group}{when} were refused ({words})")
        self._note({"fault": self._faults[-1]})

    def closed(self, meta: Meta, despite_faults: bool) -> Meta:
        """Return the final metadata, which tell of the gaps, the faults and the number of readings that were left out.

        Args:
            meta: Metadata of the episode without these facts.
            despite_faults: Whether an episode with a fault may be a success.

        Raises:
            FieldError: If the episode has a fault and is to be a success, and `despite_faults` is False.
        """
        span = self._clocks[OBSERVATIONS].found
        rates = declared_rates(meta.config)
        faults = [*self.faults, *clock_faults(self._clocks, (span.first_ns, span.last_ns), self._gaps, rates)]
        if faults and meta.success and not despite_faults:
            raise FieldError(
                f"episode {meta.index} is not sealed as a success: {'; '.join(faults)}. Seal it with success=False, or "
                "with despite_faults=True; a sensor that drops out is declared with gap()"
            )
        dropped = {group: clock.dropped for group, clock in self._clocks.items() if clock.dropped}
        entry = {name: found for name, found in (("faults", faults), ("late", dropped)) if found}
        return replace(
            meta,
            annotations=[*meta.annotations, *self._annotations()],
            history=[*meta.history, {"tool": TOOL, **entry}] if entry else meta.history,
        )

    def _annotations(self) -> list[dict[str, Any]]:
        last_ns = max(clock.found.last_ns for clock in self._clocks.values() if clock.found.count)
        every = [gap.annotation(0, last_ns, TOOL) for gap in self._gaps]
        return [annotation for annotation in every if annotation]
