"""Recording an episode of any length: memory stays flat, and whatever ends the recording costs half a second of it."""

import threading
from collections.abc import Collection, Iterable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import asdict, replace
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from svfl_data.datasets.dataset import Dataset
from svfl_data.datasets.held_folder import HeldFolder
from svfl_data.errors import DatasetError, FieldError, StorageError, UsageError
from svfl_data.recording.consistency import Agreement
from svfl_data.recording.growth import Growth, check_constants
from svfl_data.recording.index_locks import build, claim, publish
from svfl_data.recording.journal import LABEL_BYTES, JournalWriter, read_journal
from svfl_data.recording.recording_clocks import Gap, Late, is_clock
from svfl_data.recording.recording_log import RecordingLog
from svfl_data.recording.write_behind import WhenFull, WriteBehind
from svfl_data.schema.episode import Meta, canonical_json
from svfl_data.schema.fields import EXTRA, field_at
from svfl_data.storage.metadata import checked_meta
from svfl_data.storage.store import Rows
from svfl_data.system.own_process import OwnProcess

META_BYTES = LABEL_BYTES // 2
"""Metadata of an episode at most, as JSON; room is left for what its end adds."""


class EpisodeWriter(OwnProcess):
    """Streams one episode into a dataset.

    Several writers, in any processes, may write into one dataset at once, and several threads may append to an episode.
    Readings go to a journal, which `seal` turns into the episode file: whole or absent, and byte for byte what
    `svfl_data.storage.store.write_episode` would have written. Leaving the ``with`` block in any other way (an
    exception, a kill, a power cut) leaves the journal, from which ``svfl-data repair`` makes an episode marked as no
    success; `discard` throws it away.

        with EpisodeWriter(dataset, meta, constants) as writer:
            writer.append("streams/wrench", t_ns=t_ns, wrench=wrench)  # shapes (M,), (M, 6): any number of rows
            writer.append("cameras/front", t_ns=t_ns, color=color)     # shapes (F,), (F, H, W, 3)
            path = writer.seal(success=True)

    Appending does not wait for the disk: a thread of the writer's hands the readings over. Errors of the disk
    surface at the next `append`, `flush` or `seal`. A writer belongs to the process that made it: a forked process may
    not use it, and it can be neither pickled nor copied; send readings to its process.

    A fault of the recording stays with the episode: what `append` refused, a stream that fell silent, a rate that is
    not the declared one. With one, `seal` refuses to call the episode a success unless told to.

    Args:
        dataset: Where to record.
        meta: What the episode is about; an index of `svfl_data.recording.index_locks.NEXT` stands for the next free
            one.
        constants: Arrays that the episode has once, by dataset path: workspace, tare, calibration of every camera.
        rates_hz: Nominal rates by group, such as ``{"streams/wrench": 500}``; kept in the episode's configuration.
        varies: Paths and groups in which this dataset's episodes may differ, such as the pose of a camera that is moved
            on purpose (``cameras/front/T_base_camera``); all other calibrations, rates and row shapes must agree.
        flush_s: Seconds after which readings are handed to the system: what a killed process loses at most, [s]. With 0
            every `append` hands them over itself and waits for that.
        sync_s: Seconds after which the disk is told to keep them: with `flush_s`, what a power cut loses at most, [s].
        most_waiting_bytes: Readings that may wait in memory while the disk is slower than the data.
        when_full: What `append` does beyond that: ``wait`` until there is room, or ``refuse`` the rows with a
            StorageError, for a caller that must not be held up.

    Raises:
        DatasetError: If the task, a camera or a rate is not the dataset's, or the wanted index is taken.
        FieldError: If a constant is missing or does not fit its declaration.
        FormatError: If the folder is not a dataset.
        StorageError: If the disk refuses.

    Example:
        >>> week = Dataset.create_or_resume("data/mine", "wiping", seed=0, config={})
        >>> tared = {"workspace": np.array([[0.3, 0.7], [-0.2, 0.2], [0, 0.3]]), "streams/wrench/tare": np.zeros(6)}
        >>> with EpisodeWriter(week, Meta("wiping", 0, 0, "teleop", success=True), tared) as writer:
        ...     at = np.arange(1, 101) * 2_000_000
        ...     writer.append("streams/wrench", t_ns=at, wrench=np.zeros((100, 6), np.float32))
        ...     writer.append("observations", t_ns=at[49::50], proprio=np.zeros((2, 5), np.float32))
        ...     writer.append("actions", action=np.zeros((1, 5), np.float32))
        ...     path = writer.seal(success=True)
        >>> len(week)
        1
    """

    instead = "send readings to the process that records (multiprocessing.Queue), or record another episode there"

    def __init__(
        self,
        dataset: Dataset | Path | str,
        meta: Meta,
        constants: Mapping[str, np.ndarray],
        rates_hz: Mapping[str, float] | None = None,
        varies: Collection[str] = (),
        flush_s: float = 0.5,
        sync_s: float = 5.0,
        most_waiting_bytes: int = 2**28,
        when_full: WhenFull = "wait",
    ) -> None:
        self._dataset = dataset if isinstance(dataset, Dataset) else Dataset.open(dataset)
        self._lock = threading.RLock()  # of what the episode consists of; the disk is never asked under it
        self._constants = {path: np.asarray(array) for path, array in constants.items()}
        self._growth = Growth(self._constants)
        declared = {"rates_hz": dict(rates_hz or {}), "varies": sorted(varies)}
        config = {**meta.config, **{key: value for key, value in declared.items() if value}}
        meta = self._checked(replace(meta, config=config))
        check_constants(self._constants)
        self._folder = HeldFolder(self._dataset.path)
        try:
            index, descriptor, journal = claim(self._dataset, meta.index)
        except BaseException:
            self._folder.close()
            raise
        self.meta = replace(meta, index=index)
        self._journal = JournalWriter(descriptor, journal)
        self._behind = WriteBehind(self._journal, flush_s, sync_s, most_waiting_bytes, when_full)
        self._log = RecordingLog(self._behind.note)
        self._agreement: Agreement | None = None
        self._ended = self._closed = False
        try:
            self._agreement = Agreement(self._dataset, journal, self.meta, self._constants)
            self._behind.record({"meta": asdict(self.meta)})
            self._append_constants(self._constants)
        except BaseException:
            self.discard()
            raise

    def append(self, group: str, *, late: Late = "refuse", **columns: np.ndarray) -> None:
        """Add readings of one clock, any number of rows at a time; they are copied.

        Whatever is refused here marks the episode, also where the error ends a sensor's thread unseen: see `seal`.

        Args:
            group: Streams that share a clock: ``observations``, ``actions``, ``streams/...``, ``cameras/...`` or one
                below ``extra/``.
            late: What to do with readings that are not newer than those before them: refuse the rows, or ``drop`` these
                readings and note their number in the episode's history. Not for observations, which actions go with.
            columns: Name of each stream to its rows, all of the same number.

        Raises:
            FieldError: If they do not fit their declarations or what the group began with, or if their time stamps do
                not ascend; nothing is stored.
            DatasetError: If images have another size, or joints another number, than in the dataset's other episodes.
            StorageError: If the disk refused what was appended before, or too much waits; these rows are not taken,
                what was appended before is intact.
            UsageError: If the episode has ended, or in another process.
        """
        self._check_open()
        arrays = {f"{group}/{name}": np.asarray(rows) for name, rows in columns.items()}
        try:
            self._append(group, arrays, late)
        except (FieldError, DatasetError, StorageError) as error:
            with self._lock:
                self._log.mark(group, arrays.get(f"{group}/t_ns"), str(error))
            raise

    def _append(self, group: str, arrays: dict[str, np.ndarray], late: Late) -> None:
        if not arrays:
            raise FieldError(f"{group}: no rows were given")
        if late == "drop" and group == "observations":
            raise UsageError("observations cannot be dropped: an action follows each")
        first = self._growth.check(group, arrays)
        if first and self._agreement and not group.startswith(EXTRA):
            self._agreement.extend(arrays)  # reads files, so outside the lock: other sensors do not wait for it
        with self._lock:
            self._check_open()
            if first and self._growth.check(group, arrays):  # unless another thread was first
                self._growth.begin(group, arrays)
            t_ns = arrays.get(f"{group}/t_ns")
            newer = None if t_ns is None or not is_clock(t_ns) else self._log.newer(group, t_ns, late)
            kept = {path: rows.copy() if newer is None else rows[newer] for path, rows in arrays.items()}
            self._behind.append(kept)
            if t_ns is not None and is_clock(t_ns):
                self._log.take(group, kept[f"{group}/t_ns"], len(t_ns) - len(kept[f"{group}/t_ns"]))

    def gap(self, group: str, start_ns: int, end_ns: int | None, reason: str) -> None:
        """Say that a stream has no readings for a while, because its sensor dropped out; nothing is invented for it.

        The gap becomes an annotation, ``{"name": "gap", "stream": group, "start_ns", "end_ns", "reason", "by"}``.

        Args:
            group: The streams that lack readings, such as ``streams/wrench``.
            start_ns: From when, [ns] of the episode clock.
            end_ns: Until when; None until the next reading of this group. Saying so again before that changes nothing.
            reason: In words, for whoever reads the episode.

        Raises:
            FieldError: If there is no such group.
            UsageError: If the times or the reason are none, if the episode has ended, or in another process.
        """
        self._check_open()
        if not group.startswith(EXTRA) and field_at(f"{group}/t_ns") is None:
            raise FieldError(f"{group}: no group with a clock; a gap is one of streams/..., cameras/... or extra/...")
        with self._lock:
            self._log.declare(Gap(group, int(start_ns), None if end_ns is None else int(end_ns), reason))

    def flush(self) -> None:
        """Gripper everything appended so far to the system and wait; a killed process does not lose it any more.

        Raises:
            StorageError: If the disk refuses; what did not fit is kept in memory and tried again.
            UsageError: If the episode has ended, or in another process.
        """
        self._check_open()
        self._behind.flush()

    @property
    def faults(self) -> list[str]:
        """What is wrong with the recording so far, in words; empty if nothing is known to be."""
        with self._lock:
            return self._log.faults

    def seal(
        self,
        success: bool | None = None,
        annotations: Iterable[dict[str, Any]] = (),
        constants: Mapping[str, np.ndarray] | None = None,
        despite_faults: bool = False,
    ) -> Path:
        """End the episode and publish it.

        Args:
            success: Whether the task was achieved; None keeps what `meta` said.
            annotations: Named intervals to add to the metadata.
            constants: Arrays that are only known now, such as ``labels/offset``.
            despite_faults: Whether an episode with a fault may be called a success. The fault stays in its history.

        Returns:
            The episode's file.

        Raises:
            FieldError: If the episode is not whole, such as one action too many; append what is missing, or discard. Or
                if it is to be a success in spite of a fault: an append that was refused, a stream that was silent for
                over a second at the end or for a tenth of the episode without a declared gap, a rate that is not the
                declared one, time stamps that cannot be nanoseconds.
            StorageError: If the disk refuses, or the dataset's folder is gone; make room and seal again, or leave it to
                ``svfl-data repair``.
            UsageError: If the episode has ended, or in another process.
        """
        with self._ending():
            return self._publish(self._last_words(success, annotations, constants, despite_faults))

    def seal_beside(
        self,
        success: bool | None = None,
        annotations: Iterable[dict[str, Any]] = (),
        constants: Mapping[str, np.ndarray] | None = None,
        despite_faults: bool = False,
    ) -> "Future[Path]":
        """End the episode and publish it in a thread of its own, while the next one may be recorded.

        What `seal` would refuse is refused at once; what takes time (reading, compressing, writing) goes on when this
        has returned, also after the ``with`` block.

        Args:
            success: As for `seal`.
            annotations: As for `seal`.
            constants: As for `seal`.
            despite_faults: As for `seal`.

        Returns:
            Gives the episode's file, or raises what `seal` raises, in ``result()``. If the disk refused, the journal is
            left to ``svfl-data repair``. A process that ends normally waits for it.

        Raises:
            FieldError: As for `seal`.
            StorageError: If the disk refuses the last readings.
            UsageError: If the episode has ended, or in another process.
        """
        with self._ending():
            meta = self._last_words(success, annotations, constants, despite_faults)
            thread = ThreadPoolExecutor(1, f"seal episode {meta.index}")
            self._closed = True  # for the caller; the thread closes what is open
            sealing = thread.submit(self._publish_and_close, meta)
            thread.shutdown(wait=False)
            return sealing

    def discard(self) -> None:
        """End the episode and throw away what was recorded; does nothing after `seal`.

        Raises:
            StorageError: If the disk refuses.
            UsageError: In another process.
        """
        self.check_process()
        if self._closed:
            return
        try:
            self._journal.path.unlink(missing_ok=True)
        except OSError as error:
            raise StorageError(f"cannot remove {self._journal.path}: {error.strerror}") from error
        finally:
            self._close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._closed or not self.in_own_process:
            return
        try:
            self.flush()
        finally:
            self._close()

    def __repr__(self) -> str:
        rows = ", ".join(f"{path} {count}" for path, count in self._behind.stored.items())
        return f"EpisodeWriter(episode {self.meta.index} of {self._dataset.path}: {rows or 'nothing stored yet'})"

    @contextmanager
    def _ending(self) -> Iterator[None]:
        """Refuse appends from now on, unless the episode cannot end."""
        self._check_open()
        with self._lock:
            self._ended = True
        try:
            yield
        except BaseException:
            self._ended = False
            raise

    def _last_words(
        self,
        success: bool | None,
        annotations: Iterable[dict[str, Any]],
        constants: Mapping[str, np.ndarray] | None,
        despite_faults: bool,
    ) -> Meta:
        """Final metadata of an episode that is whole; the journal has it, too."""
        late = {path: np.asarray(array) for path, array in (constants or {}).items()}
        check_constants(late, required=False)
        success = self.meta.success if success is None else bool(success)
        meta = replace(self.meta, success=success, annotations=[*self.meta.annotations, *annotations])
        meta = self._checked(meta)
        self._behind.flush()
        self._growth.check_whole(self._behind.stored, late, f"episode {meta.index}")
        meta = self._log.closed(meta, despite_faults)
        if self._agreement and self._folder.in_place:  # if not, `_publish` says so when all is written down
            self._agreement.confirm(late)
        self._append_constants(late)
        self._behind.record({"end": asdict(meta)})
        return meta

    def _publish(self, meta: Meta) -> Path:
        self._folder.check()
        path = self._dataset.episode_path(meta.index)
        try:
            part = build(self._dataset, meta, self._recorded())
            self._folder.check()
            publish(part, path)
        except FileExistsError as error:
            part.unlink()
            raise DatasetError(f"{path} was written by someone else meanwhile; svfl-data repair keeps both") from error
        except StorageError:
            self._folder.check()  # says more
            raise
        with suppress(OSError):  # else repair sees that the episode was published
            self._journal.path.unlink(missing_ok=True)
        self._close()
        return path

    def _publish_and_close(self, meta: Meta) -> Path:
        try:
            return self._publish(meta)
        finally:
            self._close()

    def _close(self) -> None:
        if self._agreement:
            self._agreement.leave()
        self._behind.close()
        self._journal.close()
        self._folder.close()
        self._ended = self._closed = True

    def _recorded(self) -> dict[str, Rows]:
        try:
            journal = read_journal(self._journal.descriptor)
        except OSError as error:
            raise StorageError(f"cannot read {self._journal.path}: {error.strerror}") from error
        if journal.damaged:
            raise StorageError(
                f"{self._journal.path}: the disk gave back other bytes than were written; svfl-data repair saves what "
                "is intact"
            )
        return {**journal.constants, **{path: stream.rows() for path, stream in journal.streams.items()}}

    def _append_constants(self, constants: Mapping[str, np.ndarray]) -> None:
        for path, array in constants.items():
            label = {"path": path, "dtype": array.dtype.str, "shape": array.shape, "constant": True}
            self._behind.record(label, array.tobytes())

    def _checked(self, meta: Meta) -> Meta:
        if meta.task not in str(self._dataset.info["task"]).split("+"):
            raise DatasetError(f"{self._dataset.path} is of task {self._dataset.info['task']!r}, not {meta.task!r}")
        meta = checked_meta(meta)
        if (size := len(canonical_json(asdict(meta)).encode())) > META_BYTES:
            raise FieldError(
                f"metadata of episode {meta.index} take {size} bytes of JSON, at most {META_BYTES} are stored"
            )
        return meta

    def _check_open(self) -> None:
        self.check_process()
        if self._ended:
            raise UsageError(f"episode {self.meta.index} has ended; start another EpisodeWriter")
