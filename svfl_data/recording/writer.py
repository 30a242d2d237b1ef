"""Recording of episodes of any length in constant memory; a crash loses at most the last half second by default."""

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
from svfl_data.recording.journal import LABEL_BYTES, read_journal
from svfl_data.recording.journal_writer import JournalWriter
from svfl_data.recording.recording_clocks import Gap, Late, is_clock
from svfl_data.recording.recording_log import RecordingLog
from svfl_data.recording.write_behind import WhenFull, WriteBehind
from svfl_data.schema.declarations import Declarations
from svfl_data.schema.episode import Meta, canonical_json
from svfl_data.schema.field import Field
from svfl_data.schema.fields import EXTRA
from svfl_data.schema.rates import checked_rates
from svfl_data.storage.metadata import checked_meta
from svfl_data.storage.store import Rows
from svfl_data.system.own_process import OwnProcess

META_BYTES = LABEL_BYTES // 2
"""Largest size of an episode's metadata as JSON, [bytes]. It leaves room in the label for what sealing adds."""


class EpisodeWriter(OwnProcess):
    """Writer that streams one episode into a dataset.

    Several writers, in any processes, may write into one dataset at once, and several threads may append to an episode.
    Readings are written to a journal, which `seal` turns into the episode file. This file is either whole or absent,
    and has the same bytes as one from `svfl_data.storage.store.write_episode`. If the ``with`` block ends in another
    way (by an exception, a kill or a power cut), the journal remains, from which ``svfl-data repair`` makes an episode
    that is marked as no success. `discard` deletes the journal.

        with EpisodeWriter(dataset, meta, constants) as writer:
            writer.append("streams/wrench", t_ns=t_ns, wrench=wrench)  # shapes (M,), (M, 6): any number of rows
            writer.append("cameras/front", t_ns=t_ns, color=color)     # shapes (F,), (F, H, W, 3)
            path = writer.seal(success=True)

    Appending does not wait for the disk, since a thread of the writer passes the readings on to the journal. Errors of
    the disk are raised by the next `append`, `flush` or `seal`. A writer belongs to the process that made it. A forked
    process may not use it, and it can be neither pickled nor copied. Other processes must send their readings to the
    process of the writer.

    A fault of the recording stays with the episode: rows that `append` refused, a stream that fell silent, or a rate
    that is not the declared one. `seal` refuses to mark an episode with a fault as a success, unless told to do so.

    Args:
        dataset: Dataset, or path of its folder, into which the episode is recorded.
        meta: Metadata of the episode. The index `svfl_data.recording.index_locks.NEXT` stands for the next free index.
        constants: Arrays that the episode has once, by dataset path, such as workspace, tare, and the calibration of
            the cameras.
        fields: Declarations of the user's own arrays, and of the action if it is another than the planar one.
        rates_hz: Nominal rates by group, such as ``{"streams/wrench": 500}``, [Hz]. They are stored in the
            configuration of the episode. None means that no rates are declared.
        varies: Dataset paths and groups in which episodes of this dataset may differ, such as the pose of a camera that
            is moved on purpose (``cameras/front/T_base_camera``). All other calibrations, rates and row shapes must
            agree.
        flush_s: Time after which readings are passed to the system, which is the most that a killed process loses, [s].
            With 0 every `append` passes its readings on itself and waits for that.
        sync_s: Time after which the disk is told to keep the readings, [s]. A power cut loses at most this plus
            `flush_s`.
        most_waiting_bytes: Largest size of the readings that may wait in memory while the disk is slower than the data,
            [bytes].
        when_full: What `append` does beyond `most_waiting_bytes`: ``wait`` until there is room, or ``refuse`` the rows
            with a StorageError, for a caller that must not be delayed.

    Raises:
        DatasetError: If task, cameras, calibrations or rates differ from those of the dataset, or the wanted index is
            taken.
        FieldError: If a declaration contradicts itself or a standard field, a constant is not declared or does not fit
            its declaration, or the metadata cannot be stored.
        FormatError: If the folder is not a dataset.
        StorageError: If the disk refuses.
        UsageError: If a rate is not a number above 0.

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
        fields: Iterable[Field] = (),
        rates_hz: Mapping[str, float] | None = None,
        varies: Collection[str] = (),
        flush_s: float = 0.5,
        sync_s: float = 5.0,
        most_waiting_bytes: int = 2**28,
        when_full: WhenFull = "wait",
    ) -> None:
        self._dataset = dataset if isinstance(dataset, Dataset) else Dataset.open(dataset)
        self._lock = threading.RLock()  # guards the content of the episode; never held during disk access
        self._constants = {path: np.asarray(array) for path, array in constants.items()}
        self.declarations = Declarations(fields)
        self._growth = Growth(self._constants, self.declarations)
        declared = {"rates_hz": checked_rates(rates_hz or {}), "varies": sorted(varies)}
        config = {**meta.config, **{key: value for key, value in declared.items() if value}}
        meta = self._checked(replace(meta, config=config))
        check_constants(self._constants, self.declarations)
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
            self._agreement = Agreement(self._dataset, journal, self.meta, self._constants, self.declarations)
            declared = {one.path: {"dtype": one.dtype, **one.attributes} for one in self.declarations.own}
            self._behind.record({"meta": asdict(self.meta), "declared": declared})
            self._append_constants(self._constants)
        except BaseException:
            self.discard()
            raise

    def append(self, group: str, *, late: Late = "refuse", **columns: np.ndarray) -> None:
        """Append any number of readings of one clock; the rows are copied.

        If rows are refused by one of the errors below other than a UsageError, the episode is marked with a fault, even
        if the error ends a sensor's thread unnoticed; see `seal`.

        Args:
            group: Group of streams that share a clock: ``observations``, ``actions``, ``streams/...``, ``cameras/...``
                or a group below ``extra/``.
            late: What to do with readings that are not newer than those before them: ``refuse`` all rows of this call,
                or ``drop`` the late readings and note their number in the episode's history. Observations cannot be
                dropped, since an action follows each of them.
            columns: Rows of each stream by name. All streams must have the same number of rows.

        Raises:
            FieldError: If the rows do not fit their declarations or the first rows of the group, or if their time
                stamps do not ascend; nothing is stored.
            DatasetError: If images have another size, or joints another number, than in the dataset's other episodes.
            StorageError: If the disk refused earlier rows, or too many readings are waiting. These rows are not taken,
                and all earlier rows are intact.
            UsageError: If the episode has ended, if observations are to be dropped, or in another process.
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
            self._agreement.extend(arrays)  # reads files: outside the lock, so that other sensors need not wait
        with self._lock:
            self._check_open()
            if first and self._growth.check(group, arrays):  # again, since another thread may have been first
                self._growth.begin(group, arrays)
            t_ns = arrays.get(f"{group}/t_ns")
            newer = None if t_ns is None or not is_clock(t_ns) else self._log.newer(group, t_ns, late)
            kept = {path: rows.copy() if newer is None else rows[newer] for path, rows in arrays.items()}
            self._behind.append(kept)
            if t_ns is not None and is_clock(t_ns):
                self._log.take(group, kept[f"{group}/t_ns"], len(t_ns) - len(kept[f"{group}/t_ns"]))

    def gap(self, group: str, start_ns: int, end_ns: int | None, reason: str) -> None:
        """Declare that a stream has no readings for some time because its sensor dropped out; no readings are invented.

        The gap becomes an annotation, ``{"name": "gap", "stream": group, "start_ns", "end_ns", "reason", "by"}``.

        Args:
            group: Group whose readings are missing, such as ``streams/wrench``.
            start_ns: Start of the gap on the episode clock, [ns].
            end_ns: End of the gap on the episode clock, [ns]. None means that the gap lasts until the next reading of
                this group. A further gap without an end has no effect until then.
            reason: Reason for the gap in words, for the readers of the episode.

        Raises:
            FieldError: If there is no such group, or the group has no clock.
            UsageError: If the times are not in order or the reason is empty, if the episode has ended, or in another
                process.
        """
        self._check_open()
        if not group.startswith(EXTRA) and self.declarations.at(f"{group}/t_ns") is None:
            raise FieldError(f"{group}: no group with a clock; a gap is one of streams/..., cameras/... or extra/...")
        with self._lock:
            self._log.declare(Gap(group, int(start_ns), None if end_ns is None else int(end_ns), reason))

    def flush(self) -> None:
        """Pass all readings appended so far to the system, and wait; a killed process does not lose them any more.

        Raises:
            StorageError: If the disk refuses. The rest is kept in memory, and the writer tries again.
            UsageError: If the episode has ended, or in another process.
        """
        self._check_open()
        self._behind.flush()

    @property
    def faults(self) -> list[str]:
        """Known faults of the recording so far, in words; empty if there are none."""
        with self._lock:
            return self._log.faults

    def seal(
        self,
        success: bool | None = None,
        annotations: Iterable[dict[str, Any]] = (),
        constants: Mapping[str, np.ndarray] | None = None,
        despite_faults: bool = False,
        config: Mapping[str, Any] | None = None,
        replaces: int | None = None,
    ) -> Path:
        """End the episode and publish it.

        Args:
            success: Whether the task was achieved. None keeps the value in `meta`.
            annotations: Annotations (named intervals of the episode clock) to add to the metadata.
            constants: Constants that are only known now, such as ``labels/offset`` or a later tare, by dataset path.
            despite_faults: Whether an episode with a fault may be a success. The fault stays in the episode's history.
            config: Entries of the configuration that are only known now, JSON values.
            replaces: Index of an episode of the dataset whose place this one takes, because it was recorded again. None
                keeps the index of `meta`.

        Returns:
            Path of the episode's file.

        Raises:
            FieldError: If the episode is not whole, for example because of one action too many. Append what is missing,
                or discard the episode. Also if the episode is to be a success in spite of a fault: an append that was
                refused, a stream that was silent for over a second at the end or for a tenth of the episode without a
                declared gap, a rate that is not the declared one, or time stamps that cannot be nanoseconds.
            DatasetError: If the setup differs from that of episodes that were sealed meanwhile, or someone else has
                written the episode's file.
            StorageError: If the disk refuses, or the dataset's folder is gone. Make room and seal again, or use
                ``svfl-data repair``.
            UsageError: If the episode has ended, or in another process.
        """
        with self._ending():
            meta = self._last_words(success, annotations, constants, despite_faults, config or {})
            return self._publish(meta, replaces)

    def seal_beside(
        self,
        success: bool | None = None,
        annotations: Iterable[dict[str, Any]] = (),
        constants: Mapping[str, np.ndarray] | None = None,
        despite_faults: bool = False,
    ) -> "Future[Path]":
        """End the episode and publish it in a separate thread, while the next episode may be recorded.

        The episode is checked before this method returns, so that faults are raised at once. The slow part (reading,
        compressing and writing) continues afterwards, even after the ``with`` block.

        Args:
            success: Whether the task was achieved. None keeps the value in `meta`.
            annotations: Annotations (named intervals of the episode clock) to add to the metadata.
            constants: Constants that are only known now, such as ``labels/offset`` or a later tare, by dataset path.
            despite_faults: Whether an episode with a fault may be a success. The fault stays in the episode's history.

        Returns:
            Future whose ``result()`` gives the path of the episode's file, or raises the errors of `seal`. If the disk
            refused, the journal remains for ``svfl-data repair``. A process that ends normally waits for the future.

        Raises:
            FieldError: If the episode is not whole, or is to be a success in spite of a fault; see `seal`.
            DatasetError: If the setup differs from that of episodes that were sealed meanwhile.
            StorageError: If the disk refuses the last readings.
            UsageError: If the episode has ended, or in another process.
        """
        with self._ending():
            meta = self._last_words(success, annotations, constants, despite_faults, {})
            thread = ThreadPoolExecutor(1, f"seal episode {meta.index}")
            self._closed = True  # for the caller; the thread closes the files
            sealing = thread.submit(self._publish_and_close, meta)
            thread.shutdown(wait=False)
            return sealing

    def discard(self) -> None:
        """End the episode and delete what was recorded; after `seal` this method does nothing.

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
        """Refuse appends from now on; if the ``with`` block fails, appends are allowed again."""
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
        config: Mapping[str, Any],
    ) -> Meta:
        """Check that the episode is whole, write its final metadata to the journal, and return the metadata."""
        late = {path: np.asarray(array) for path, array in (constants or {}).items()}
        check_constants(late, self.declarations)
        success = self.meta.success if success is None else bool(success)
        marks = [*self.meta.annotations, *annotations]
        meta = replace(self.meta, success=success, annotations=marks, config={**self.meta.config, **config})
        meta = self._checked(meta)
        self._behind.flush()
        self._growth.check_whole(self._behind.stored, late, f"episode {meta.index}")
        meta = self._log.closed(meta, despite_faults)
        if self._agreement and self._folder.in_place:  # if not, `_publish` raises the error, after the end is recorded
            self._agreement.confirm(late)
        self._append_constants(late)
        self._behind.record({"end": asdict(meta)})
        return meta

    def _publish(self, meta: Meta, replaces: int | None = None) -> Path:
        self._folder.check()
        meta = meta if replaces is None else replace(meta, index=replaces)
        path = self._dataset.episode_path(meta.index)
        try:
            part = build(self._dataset, meta, self._recorded(), self.declarations)
            self._folder.check()
            publish(part, path, replace=replaces is not None)
        except FileExistsError as error:
            part.unlink()
            raise DatasetError(f"{path} was written by someone else meanwhile; svfl-data repair keeps both") from error
        except StorageError:
            self._folder.check()  # raises a better message if the folder is gone
            raise
        with suppress(OSError):  # if this fails, repair finds that the episode was published
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
                f"{self._journal.path}: the bytes that were read differ from those that were written; svfl-data repair "
                "saves what is intact"
            )
        return {**journal.constants, **{path: stream.rows() for path, stream in journal.streams.items()}}

    def _append_constants(self, constants: Mapping[str, np.ndarray]) -> None:
        for path, array in constants.items():
            label = {"path": path, "dtype": array.dtype.str, "shape": array.shape, "constant": True}
            self._behind.record(label, array.tobytes())

    def _checked(self, meta: Meta) -> Meta:
        if meta.task not in str(self._dataset.info["task"]).split("+"):
            of = str(self._dataset.info["task"])
            raise DatasetError(
                f"{self._dataset.path} is of task {of!r}, not {meta.task!r}; a dataset of both is created with the "
                f"task {f'{of}+{meta.task}'!r}"
            )
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
