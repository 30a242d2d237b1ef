"""What a recording knows about itself: its clocks, its declared gaps, and what went wrong, until it is sealed."""

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
"""Faults of an episode that are kept in words; of more only the number."""
WRENCH, OBSERVATIONS = "streams/wrench", "observations"


class RecordingLog:
    """The log of one episode; whoever uses it from several threads holds a lock.

    Args:
        note: Puts a record without rows into the episode's journal, so that repair knows of it.
    """

    def __init__(self, note: Callable[[dict[str, Any]], None]) -> None:
        self._note = note
        self._clocks: dict[str, Clock] = {}
        self._gaps: list[Gap] = []
        self._faults: list[str] = []
        self._beyond = 0

    @property
    def faults(self) -> list[str]:
        """What went wrong so far, in words."""
        return [*self._faults, *([f"and {self._beyond} more"] if self._beyond else [])]

    def newer(self, group: str, t_ns: np.ndarray, late: Late) -> np.ndarray | None:
        """Which rows of a group may be appended; see `svfl_data.recording.recording_clocks.Clock.newer`."""
        return self._clocks.setdefault(group, Clock()).newer(group, t_ns, late)

    def take(self, group: str, t_ns: np.ndarray, dropped: int) -> None:
        """Count rows that were appended, and some that were left out; a reading ends an open gap."""
        self._clocks[group].take(t_ns)
        self._clocks[group].dropped += dropped
        for row, gap in enumerate(self._gaps if len(t_ns) else ()):
            if gap.stream == group and gap.end_ns is None and t_ns[0] >= gap.start_ns:
                self._gaps[row] = replace(gap, end_ns=int(t_ns[0]))
                self._note({"gap": asdict(self._gaps[row])})

    def declare(self, gap: Gap) -> None:
        """Keep a gap, unless one without an end is open in the same stream and this has none either."""
        if gap.end_ns is None and any(known.stream == gap.stream and known.end_ns is None for known in self._gaps):
            return
        self._gaps.append(gap)
        self._note({"gap": asdict(gap)})

    def mark(self, group: str, t_ns: np.ndarray | None, words: str) -> None:
        """Keep a fault.

        Args:
            group: What was appended to.
            t_ns: Time stamps of what was refused, if it had any.
            words: Why.
        """
        if len(self._faults) == FAULTS:
            self._beyond += 1
            return
        when = f" at {t_ns.flat[0] / 1e9:.3f} s" if t_ns is not None and t_ns.size and t_ns.dtype.kind in "iu" else ""
        self._faults.append(f"readings of {group}{when} were refused ({words})")
        self._note({"fault": self._faults[-1]})

    def closed(self, meta: Meta, despite_faults: bool) -> Meta:
        """The final metadata, with gaps, faults and readings left out.

        Raises:
            FieldError: If the episode is to be a success in spite of a fault.
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
        last_ns = max(clock.found.last_ns for group, clock in self._clocks.items() if group in (OBSERVATIONS, WRENCH))
        every = [gap.annotation(0, last_ns, TOOL) for gap in self._gaps]
        return [annotation for annotation in every if annotation]
