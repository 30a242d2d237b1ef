"""Recording an episode of any length: memory stays flat, and whatever ends the recording costs half a second of it."""

import threading
import time
from collections.abc import Collection, Iterable, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from svfl_data.agreement import Agreement
from svfl_data.claims import build, claim, publish
from svfl_data.dataset import Dataset
from svfl_data.episode import Meta
from svfl_data.errors import DatasetError, FieldError, StorageError, UsageError
from svfl_data.fields import EXTRA
from svfl_data.growth import Growth, check_constants
from svfl_data.journal import JournalWriter, read_journal
from svfl_data.metadata import checked_meta
from svfl_data.store import Rows

FLUSH_BYTES = 2**23
"""Readings that wait in memory at most; more are handed over at once, whatever the time."""


class EpisodeWriter:
    """Streams one episode into a dataset.

    Several writers, in any processes, may write into one dataset at once, and several threads may append to an episode.
    Readings go to a journal, which `seal` turns into the episode file: whole or absent, and byte for byte what
    `svfl_data.store.write_episode` would have written. Leaving the ``with`` block in any other way (an exception, a
    kill, a power cut) leaves the journal, from which ``svfl-data repair`` makes an episode marked as no success;
    `discard` throws it away.

        with EpisodeWriter(dataset, meta, constants) as writer:
            writer.append("streams/wrench", t_ns=t_ns, wrench=wrench)  # shapes (M,), (M, 6): any number of rows
            writer.append("cameras/front", t_ns=t_ns, color=color)     # shapes (F,), (F, H, W, 3)
            path = writer.seal(success=True)

    Args:
        dataset: Where to record.
        meta: What the episode is about; an index of `svfl_data.claims.NEXT` stands for the next free one.
        constants: Arrays that the episode has once, by dataset path: workspace, tare, calibration of every camera.
        rates_hz: Nominal rates by group, such as ``{"streams/wrench": 500}``; kept in the episode's configuration.
        varies: Paths and groups in which this dataset's episodes may differ, such as the pose of a camera that is moved
            on purpose (``cameras/front/T_base_camera``); all other calibrations, rates and row shapes must agree.
        flush_s: Seconds after which readings are handed to the system: what a killed process loses at most, [s].
        sync_s: Seconds after which the disk is told to keep them: with `flush_s`, what a power cut loses at most, [s].

    Raises:
        DatasetError: If the task, a camera or a rate is not the dataset's, or the wanted index is taken.
        FieldError: If a constant is missing or does not fit its declaration.
        FormatError: If the folder is not a dataset.
        StorageError: If the disk refuses.
    """

    def __init__(
        self,
        dataset: Dataset | Path | str,
        meta: Meta,
        constants: Mapping[str, np.ndarray],
        rates_hz: Mapping[str, float] | None = None,
        varies: Collection[str] = (),
        flush_s: float = 0.5,
        sync_s: float = 5.0,
    ) -> None:
        self._dataset = dataset if isinstance(dataset, Dataset) else Dataset.open(dataset)
        self._lock = threading.RLock()
        self._flush_s, self._sync_s = flush_s, sync_s
        self._constants = {path: np.asarray(array) for path, array in constants.items()}
        self._growth = Growth(self._constants)
        self._state: tuple[dict[str, int], list[dict[str, np.ndarray]]] = {}, []  # rows stored, appends waiting
        self._waiting_bytes = 0
        declared = {"rates_hz": dict(rates_hz or {}), "varies": sorted(varies)}
        config = {**meta.config, **{key: value for key, value in declared.items() if value}}
        meta = self._checked(replace(meta, config=config))
        check_constants(self._constants)
        index, descriptor, journal = claim(self._dataset, meta.index)
        self.meta = replace(meta, index=index)
        self._journal = JournalWriter(descriptor, journal)
        self._agreement: Agreement | None = None
        self._closed = False
        self._flushed = self._synced = time.monotonic()
        try:
            self._agreement = Agreement(self._dataset, journal, self.meta, self._constants)
            self._journal.append({"meta": asdict(self.meta)})
            self._append_constants(self._constants)
        except BaseException:
            self.discard()
            raise

    def append(self, group: str, **columns: np.ndarray) -> None:
        """Add readings of one clock, any number of rows at a time; they are copied.

        Args:
            group: Streams that share a clock: ``observations``, ``actions``, ``streams/...``, ``cameras/...`` or one
                below ``extra/``.
            columns: Name of each stream to its rows, all of the same number.

        Raises:
            FieldError: If they do not fit their declarations or what the group began with; nothing is stored.
            DatasetError: If images have another size, or joints another number, than in the dataset's other episodes.
            StorageError: If the disk refuses; what was appended before is intact.
            UsageError: If the episode has ended.
        """
        self._check_open()
        arrays = {f"{group}/{name}": np.asarray(rows) for name, rows in columns.items()}
        if not arrays:
            raise FieldError(f"{group}: no rows were given")
        with self._lock:
            if self._growth.check(group, arrays):
                if self._agreement and not group.startswith(EXTRA):
                    self._agreement.extend(arrays)
                self._growth.begin(group, arrays)
            self._waiting_bytes += sum(rows.nbytes for rows in arrays.values())
            self._state[1].append({path: rows.copy() for path, rows in arrays.items()})
            if self._waiting_bytes >= FLUSH_BYTES or time.monotonic() - self._flushed >= self._flush_s:
                self.flush()

    def flush(self) -> None:
        """Hand everything appended so far to the system, from where a killed process does not lose it.

        Raises:
            StorageError: If the disk refuses; what did not fit is kept in memory and tried again at the next flush.
        """
        with self._lock:
            stored, waiting = self._state
            stored = dict(stored)
            for path in dict.fromkeys(path for arrays in waiting for path in arrays):
                rows = np.concatenate([arrays[path] for arrays in waiting if path in arrays])
                self._store(path, rows, stored.get(path, 0))
                stored[path] = stored.get(path, 0) + len(rows)
            # One assignment: whatever is interrupted before it, by Ctrl-C or the disk, is done again as a whole.
            self._state = stored, []
            self._waiting_bytes = 0
            self._flushed = time.monotonic()
            if self._flushed - self._synced >= self._sync_s:
                self._journal.sync()
                self._synced = self._flushed

    def _store(self, path: str, rows: np.ndarray, first: int) -> None:
        step = max(1, FLUSH_BYTES * len(rows) // max(1, rows.nbytes))
        for start in range(0, max(1, len(rows)), step):
            part = rows[start : start + step]
            label = {"path": path, "dtype": part.dtype.str, "shape": part.shape, "start": first + start}
            self._journal.append(label, part.tobytes())

    def seal(
        self,
        success: bool | None = None,
        annotations: Iterable[dict[str, Any]] = (),
        constants: Mapping[str, np.ndarray] | None = None,
    ) -> Path:
        """End the episode and publish it.

        Args:
            success: Whether the task was achieved; None keeps what `meta` said.
            annotations: Named intervals to add to the metadata.
            constants: Arrays that are only known now, such as ``labels/offset``.

        Returns:
            The episode's file.

        Raises:
            FieldError: If the episode is not whole, such as one action too many; append what is missing, or discard.
            StorageError: If the disk refuses; make room and seal again, or leave it to ``svfl-data repair``.
            UsageError: If the episode has ended.
        """
        self._check_open()
        late = {path: np.asarray(array) for path, array in (constants or {}).items()}
        check_constants(late, required=False)
        meta = replace(
            self.meta,
            success=self.meta.success if success is None else bool(success),
            annotations=[*self.meta.annotations, *annotations],
        )
        meta = self._checked(meta)
        self.flush()
        self._growth.check_whole(self._state[0], late, f"episode {meta.index}")
        if self._agreement:
            self._agreement.confirm(late)
        self._append_constants(late)
        self._journal.append({"end": asdict(meta)})
        path = self._dataset.episode_path(meta.index)
        part = build(self._dataset, meta, self._recorded())
        try:
            publish(part, path)
        except FileExistsError as error:
            part.unlink()
            raise DatasetError(f"{path} was written by someone else meanwhile; svfl-data repair keeps both") from error
        self.discard()
        return path

    def discard(self) -> None:
        """End the episode and throw away what was recorded; does nothing after `seal`."""
        if not self._closed:
            self._end(self._journal.path)

    def _end(self, unwanted: Path | None = None) -> None:
        if self._agreement:
            self._agreement.leave()
        if unwanted:
            unwanted.unlink(missing_ok=True)  # while it is locked
        self._journal.close()
        self._closed = True

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._closed:
            return
        try:
            self.flush()
        finally:
            self._end()

    def __repr__(self) -> str:
        rows = ", ".join(f"{path} {count}" for path, count in self._state[0].items())
        return f"EpisodeWriter(episode {self.meta.index} of {self._dataset.path}: {rows or 'nothing stored yet'})"

    def _recorded(self) -> dict[str, Rows]:
        journal = read_journal(self._journal.descriptor)
        if journal.intact != journal.size:
            raise StorageError(f"{self._journal.path}: the disk gave back other bytes than were written")
        return {**journal.constants, **journal.streams}

    def _append_constants(self, constants: Mapping[str, np.ndarray]) -> None:
        for path, array in constants.items():
            label = {"path": path, "dtype": array.dtype.str, "shape": array.shape, "constant": True}
            self._journal.append(label, array.tobytes())

    def _checked(self, meta: Meta) -> Meta:
        if meta.task not in str(self._dataset.info["task"]).split("+"):
            raise DatasetError(f"{self._dataset.path} is of task {self._dataset.info['task']!r}, not {meta.task!r}")
        return checked_meta(meta)

    def _check_open(self) -> None:
        if self._closed:
            raise UsageError(f"episode {self.meta.index} has ended; start another EpisodeWriter")
