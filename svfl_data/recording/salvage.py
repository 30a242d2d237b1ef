"""Salvage of an episode from a journal: intact rows are kept, missing rows are marked as gaps, none are invented."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import msgspec
import numpy as np

from svfl_data.errors import FormatError, UsageError
from svfl_data.recording.journal import Journal, Spans
from svfl_data.recording.recording_clocks import Gap
from svfl_data.schema.action_fields import ACTION
from svfl_data.schema.declarations import Declarations
from svfl_data.schema.episode import Meta
from svfl_data.schema.fields import EXTRA
from svfl_data.schema.validity import check_arrays
from svfl_data.storage.store import Rows

TOOL = "repair"
OBSERVATIONS, ACTIONS = "observations", "actions"


@dataclass(frozen=True)
class Salvaged:
    """An episode that was made from a journal.

    Attributes:
        meta: Metadata of the episode.
        arrays: Arrays of the episode, by dataset path.
        declarations: Declarations of the arrays.
        whole: Whether the episode holds everything that was recorded, with the final metadata of its writer.
    """

    meta: Meta
    arrays: dict[str, Rows]
    declarations: Declarations
    whole: bool


def salvage(journal: Journal, where: str) -> Salvaged:
    """Make an episode from a journal.

    If the journal is intact and its writer was already sealing it, the episode is exactly the one that the writer
    intended. Otherwise the episode is marked as no success, and each group keeps the rows that are intact in all its
    streams. Rows that are missing inside a group with a clock become a ``gap`` annotation. Steps cannot be left out in
    the middle, since each action leads from one observation to the next. So the longest run of intact steps is kept,
    and groups without a clock, which have a row per step, are cut to the same rows.

    Args:
        journal: The intact content of the journal.
        where: Name of the journal for error messages.

    Raises:
        FormatError: If the metadata of the journal are not intact.
        FieldError: If too little was recorded for an episode, or the journal holds numbers that are not valid in an
            episode.
    """
    if journal.meta is None:
        raise FormatError("its first record is damaged, so nothing can be recovered")
    if journal.end is not None and not journal.damaged:
        streams: dict[str, Rows] = {path: stream.rows() for path, stream in journal.streams.items()}
        arrays = _checked({**journal.constants, **streams}, journal.declarations, where)
        return Salvaged(journal.end, arrays, journal.declarations, whole=True)
    kept = _kept(journal)
    arrays = _checked(_with_constants(journal, _cut(journal, kept)), journal.declarations, where)
    return Salvaged(_meta(journal, kept, arrays), arrays, journal.declarations, whole=False)


def _kept(journal: Journal) -> dict[str, Spans]:
    """Return the ranges of rows of each group that are kept."""
    intact: dict[str, Spans] = {}
    for path, stream in journal.streams.items():
        group = path.rpartition("/")[0]
        intact[group] = _common(intact[group], stream.spans) if group in intact else stream.spans
    first, steps = 0, None
    if OBSERVATIONS in intact:
        first, steps = _longest_run(intact[OBSERVATIONS], intact.get(ACTIONS, []))
        intact[OBSERVATIONS] = _common(intact[OBSERVATIONS], [(first, first + steps + 1)])
    if ACTIONS in intact:
        intact[ACTIONS] = [(first, first + steps)] if steps else []
    for group, spans in intact.items():
        if group in (OBSERVATIONS, ACTIONS) or f"{group}/t_ns" in journal.streams:
            continue
        wanted = [(first, first + (steps or 0) + 1)] if first else [(0, 2**48)]
        found = _common(spans, wanted)
        intact[group] = [found[0]] if found and found[0][0] == first else []
    return intact


def _longest_run(observations: Spans, actions: Spans) -> tuple[int, int]:
    """Return the first step and the number of steps of the longest run in which no observation or action is missing."""
    followed = [(start, stop - 1) for start, stop in observations if stop - 1 > start]  # with a next observation
    runs = _common(followed, actions)
    if runs:
        start, stop = max(runs, key=lambda run: run[1] - run[0])
        return start, stop - start
    return (observations[0][0] if observations else 0), 0


def _common(one: Spans, other: Spans) -> Spans:
    """Return the rows that are in both lists of ranges; the ranges of each list are disjoint and ascending."""
    spans: Spans = []
    left, right = 0, 0
    while left < len(one) and right < len(other):
        low, high = max(one[left][0], other[right][0]), min(one[left][1], other[right][1])
        if low < high:
            spans.append((low, high))
        if one[left][1] < other[right][1]:
            left += 1
        else:
            right += 1
    return spans


def _cut(journal: Journal, kept: Mapping[str, Spans]) -> dict[str, Rows]:
    return {path: stream.rows(kept[path.rpartition("/")[0]]) for path, stream in journal.streams.items()}


def _with_constants(journal: Journal, streams: dict[str, Rows]) -> dict[str, Rows]:
    """Add constants, and an empty action if none was recorded; leave out those of cameras and streams without rows."""
    if not any(path.startswith(f"{ACTIONS}/") for path in streams):
        action = journal.declarations.at(ACTION)
        assert action is not None
        streams[ACTION] = np.zeros((0, *(size for size in action.shape[1:] if isinstance(size, int))), action.dtype)
    recorded = {path.rpartition("/")[0] for path in streams}
    known = {
        path: array
        for path, array in journal.constants.items()
        if not path.startswith(("cameras/", "streams/")) or path.rpartition("/")[0] in recorded
    }
    return {**streams, **known}


def _checked(arrays: dict[str, Rows], declarations: Declarations, where: str) -> dict[str, Rows]:
    """Return the arrays after checking that they form a valid episode."""
    check_arrays(arrays, where, declarations)
    return arrays


def _meta(journal: Journal, kept: Mapping[str, Spans], arrays: Mapping[str, Rows]) -> Meta:
    """Return the metadata of an episode that is not whole."""
    meta = journal.end or journal.meta
    assert meta is not None
    rows = {path: array.shape[0] for path, array in arrays.items() if path in journal.streams}
    entry: dict[str, Any] = {"tool": TOOL, "salvaged": True, "rows": rows}
    entry["damaged_bytes"] = sum(size for _, size in journal.damaged)
    if journal.faults:
        entry["faults"] = journal.faults
    if kept.get(OBSERVATIONS, [(0, 0)])[0][0]:
        entry["first_step"] = kept[OBSERVATIONS][0][0]
    t_ns = arrays[f"{OBSERVATIONS}/t_ns"][0 : 2**48]
    clocks = [array for path, array in arrays.items() if path.endswith("/t_ns") and not path.startswith(EXTRA)]
    last_ns = max(int(clock[clock.shape[0] - 1 : clock.shape[0]][0]) for clock in clocks if clock.shape[0])
    gaps = [*_declared(journal), *_missing(kept, arrays, int(t_ns[0]))]
    annotations = [one for gap in gaps if (one := gap.annotation(0, last_ns, TOOL))]
    if journal.end is not None:
        annotations = [one for one in annotations if one not in meta.annotations]
    return replace(meta, success=False, history=[*meta.history, entry], annotations=[*meta.annotations, *annotations])


def _declared(journal: Journal) -> list[Gap]:
    """Return the gaps that were declared while recording; of two with the same start, the later record is kept."""
    gaps: dict[tuple[str, int], Gap] = {}
    for facts in journal.gaps if journal.end is None else ():
        try:
            gap = msgspec.convert(facts, Gap)
        except (msgspec.ValidationError, UsageError):  # the record is not a valid gap
            continue
        gaps[gap.stream, gap.start_ns] = gap
    return list(gaps.values())


def _missing(kept: Mapping[str, Spans], arrays: Mapping[str, Rows], start_ns: int) -> Iterable[Gap]:
    """Yield a gap for every place in a group with a clock where rows are missing between others or before the first."""
    for group, spans in kept.items():
        t_ns = arrays.get(f"{group}/t_ns")
        if t_ns is None or group == OBSERVATIONS or not spans:
            continue
        count = 0
        for before, (first, stop) in zip([(0, 0), *spans], spans, strict=False):
            if first > before[1]:
                ends = int(t_ns[count : count + 1][0])
                began = int(t_ns[count - 1 : count][0]) if count else min(start_ns, ends)
                reason = f"{first - before[1]} rows were damaged in the journal"
                yield Gap(group, began, max(began, ends), reason)
            count += stop - first
