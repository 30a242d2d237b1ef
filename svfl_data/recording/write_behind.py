"""Writing of readings to the journal in a separate thread, so that appending need not wait for the disk.

The waiting readings are bounded in time, which limits the loss when the process is killed, and in bytes, which limits
the memory that a slow disk costs.
"""

import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from svfl_data.errors import StorageError
from svfl_data.recording.journal_writer import JournalWriter
from svfl_data.system.own_process import OwnProcess

FLUSH_BYTES = 2**23
"""Size of the waiting readings at which they are written at once, without waiting for the flush interval, [bytes]."""
WHOLE_BYTES = 2**16
"""Size from which the rows of one append become a journal record of their own, [bytes]. Smaller ones are joined."""
WhenFull = Literal["wait", "refuse"]


@dataclass(frozen=True)
class Waiting:
    """Rows and notes that were appended and are not in the journal yet.

    Attributes:
        stored: Number of rows that are in the journal, by dataset path.
        rows: Rows of each append, by dataset path, in the order of the appends.
        notes: Labels of records without rows, in order.
    """

    stored: dict[str, int]
    rows: list[dict[str, np.ndarray]] = field(default_factory=list)
    notes: list[dict[str, Any]] = field(default_factory=list)

    @property
    def empty(self) -> bool:
        """Whether neither rows nor notes are waiting."""
        return not self.rows and not self.notes


class WriteBehind(OwnProcess):
    """Buffer that passes appended rows on to a journal.

    Args:
        journal: Journal to write to.
        flush_s: Time after which waiting rows are written, [s]. With 0 every append writes its rows itself and waits.
        sync_s: Time after which the disk is told to keep the written rows, [s].
        most_bytes: Largest size of the rows that may wait in memory, [bytes].
        when_full: What an append beyond `most_bytes` does: ``wait`` until there is room, or ``refuse`` the rows.
    """

    def __init__(
        self, journal: JournalWriter, flush_s: float, sync_s: float, most_bytes: int, when_full: WhenFull
    ) -> None:
        self._journal, self._flush_s, self._sync_s = journal, flush_s, sync_s
        self._most_bytes, self._when_full = most_bytes, when_full
        self._change = threading.Condition()  # guards the waiting rows and notes; never held during disk access
        self._disk = threading.RLock()  # held by the thread that writes to the journal
        self._waiting = Waiting({})
        self._bytes = 0
        self._refusal: StorageError | None = None
        self._closed = False
        self._synced = time.monotonic()
        self._thread = threading.Thread(target=self._hand_over, name="write behind", daemon=True) if flush_s else None
        if self._thread:
            self._thread.start()

    @property
    def stored(self) -> dict[str, int]:
        """Number of rows that are in the journal, by dataset path."""
        return self._waiting.stored

    def append(self, rows: dict[str, np.ndarray]) -> None:
        """Add rows, which the caller must not change afterwards.

        Args:
            rows: Rows of one append, by dataset path.

        Raises:
            StorageError: If the disk refused earlier rows, or too many bytes are waiting; these rows are not taken.
        """
        size = sum(array.nbytes for array in rows.values())
        if self._thread is None and self._refusal is not None:
            self.flush()
        with self._change:
            self._refuse_while_refused()
            if self._bytes + size > self._most_bytes and self._bytes:
                self._wait_for_room(size)
            self._waiting.rows.append(rows)
            self._bytes += size
            if self._bytes == size or self._bytes >= FLUSH_BYTES:
                self._change.notify_all()
        if self._thread is None:
            with suppress(StorageError):  # the rows are taken; the next append raises the error
                self.flush()

    def note(self, label: dict[str, Any]) -> None:
        """Add a record without rows, given by its label; this method never waits for the disk and never fails."""
        with self._change:
            self._waiting.notes.append(label)
            self._change.notify_all()

    def flush(self) -> None:
        """Write everything that was appended so far to the journal, and wait until the system has taken it.

        Raises:
            StorageError: If the disk refuses. The rest is kept in memory, and a later flush tries again.
            UsageError: If this process is not the one that made the object.
        """
        self.check_process()
        with self._disk:
            try:
                self._write()
            except StorageError as error:
                self._refusal = error
                raise
            self._refusal = None

    def record(self, label: dict[str, Any], content: bytes | memoryview = b"") -> None:
        """Write a record to the journal at once, and wait until the system has taken it.

        Args:
            label: Label of the record (`svfl_data.recording.journal.Label`).
            content: Content of the record.

        Raises:
            StorageError: If the disk refuses.
        """
        with self._disk:
            self._journal.append(label, content)

    def close(self) -> None:
        """End the thread; rows and notes that are still waiting are dropped."""
        with self._change:
            self._closed = True
            self._change.notify_all()
        if self._thread:
            self._thread.join()

    def _refuse_while_refused(self) -> None:
        if self._refusal is not None:
            raise StorageError(str(self._refusal)) from self._refusal

    def _wait_for_room(self, size: int) -> None:
        if self._when_full == "refuse":
            raise StorageError(
                f"cannot record to {self._journal.path}: the disk is slower than the data ({self._bytes} bytes wait "
                f"in memory, {self._most_bytes} may); these rows were not recorded"
            )
        self._change.wait_for(
            lambda: self._bytes + size <= self._most_bytes or not self._bytes or self._refusal is not None
        )
        self._refuse_while_refused()

    def _write(self) -> None:
        with self._change:
            known = self._waiting
            rows, notes = list(known.rows), list(known.notes)
        stored = dict(known.stored)
        for path, array in _joined(rows):
            first = stored.get(path, 0)
            label = {"path": path, "dtype": array.dtype.str, "shape": array.shape, "start": first}
            self._journal.append(label, array.reshape(-1).view(np.uint8).data if array.size else b"")
            stored[path] = first + len(array)
        for label in notes:
            self._journal.append(label)
        with self._change:
            # A single assignment: anything that Ctrl-C or the disk interrupts before it is done again as a whole.
            self._waiting = Waiting(stored, known.rows[len(rows) :], known.notes[len(notes) :])
            self._bytes = sum(array.nbytes for arrays in self._waiting.rows for array in arrays.values())
            self._change.notify_all()
        if time.monotonic() - self._synced >= self._sync_s:
            self._journal.sync()
            self._synced = time.monotonic()

    def _hand_over(self) -> None:
        """Run the thread: wait until something was appended, gather more for a while, write, and repeat."""
        while True:
            with self._change:
                self._change.wait_for(lambda: self._closed or not self._waiting.empty)
                self._change.wait_for(lambda: self._closed or self._full(), self._flush_s)
                if self._closed:
                    return
            try:
                self.flush()
            except Exception as error:  # the next append raises it; this thread tries again
                if not isinstance(error, StorageError):
                    self._refusal = StorageError(f"cannot record to {self._journal.path}: {error!r}")
                with self._change:
                    self._change.notify_all()
                    self._change.wait_for(lambda: self._closed, self._flush_s)

    def _full(self) -> bool:
        return self._bytes >= FLUSH_BYTES


def _joined(appends: list[dict[str, np.ndarray]]) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the rows in pieces, each for one record, with their path; small appends of a stream are joined."""
    for path in dict.fromkeys(path for arrays in appends for path in arrays):
        small: list[np.ndarray] = []
        for rows in (arrays[path] for arrays in appends if path in arrays):
            if rows.nbytes >= WHOLE_BYTES:
                if small:
                    yield path, np.concatenate(small)
                yield from ((path, piece) for piece in _pieces(rows))
                small = []
            else:
                small.append(rows)
        if small:
            yield path, small[0] if len(small) == 1 else np.concatenate(small)


def _pieces(rows: np.ndarray) -> Iterator[np.ndarray]:
    step = max(1, FLUSH_BYTES * len(rows) // rows.nbytes)
    return (rows[start : start + step] for start in range(0, len(rows), step))
