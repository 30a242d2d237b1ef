"""Writer of the journal of an episode that is being recorded (`svfl_data.recording.journal`)."""

import os
import zlib
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Any

from svfl_data.errors import StorageError
from svfl_data.recording.journal import HEADER, MAGIC
from svfl_data.schema.episode import canonical_json
from svfl_data.storage.sink import write_all
from svfl_data.system.own_process import OwnProcess


class JournalWriter(OwnProcess):
    """Writer that appends records to a new journal.

    Args:
        descriptor: Descriptor of the journal file, which must be empty and open for reading and writing. `close` closes
            the descriptor.
        path: Path of the journal file, for messages.
    """

    def __init__(self, descriptor: int, path: Path) -> None:
        self.descriptor = descriptor
        self.path = path
        self._end = 0
        self._syncer = ThreadPoolExecutor(1)
        self._sync: Future[None] | None = None

    def append(self, label: dict[str, Any], content: bytes | bytearray | memoryview = b"") -> None:
        """Append a record; after the return of this method, a killed process does not lose the record any more.

        Args:
            label: Label of the record, with the keys of `Label` (JSON values).
            content: Content of the record.

        Raises:
            StorageError: If the disk refuses. The journal is then as it was before, and may be appended to again.
            UsageError: If this process is not the one that made the writer.
        """
        self.check_process()
        words = canonical_json(label).encode()
        head = HEADER.pack(MAGIC, len(words), len(content), zlib.crc32(content, zlib.crc32(words)))
        size = len(head) + len(words) + len(content)
        try:
            write_all(self.descriptor, memoryview(head + words), self._end)
            write_all(self.descriptor, memoryview(content), self._end + len(head) + len(words))
        except OSError as error:
            raise self._refusal(error, size) from error
        self._end += size

    def sync(self) -> None:
        """Start to sync the journal to the disk in a separate thread, without waiting for it.

        If an earlier sync is still running, nothing is started.

        Raises:
            StorageError: If the disk refused the previous sync.
            UsageError: If this process is not the one that made the writer.
        """
        self.check_process()
        if self._sync is not None and not self._sync.done():
            return
        try:
            if self._sync is not None:
                self._sync.result()
        except OSError as error:
            raise StorageError(f"cannot record to {self.path}: {error.strerror}") from error
        self._sync = self._syncer.submit(os.fdatasync, self.descriptor)

    def close(self) -> None:
        """Close the journal file, which also releases its lock; the file remains."""
        self._syncer.shutdown()
        descriptor, self.descriptor = self.descriptor, -1
        if descriptor >= 0:
            with suppress(OSError):  # the disk may be gone; only synced readings were promised
                os.close(descriptor)

    def forked(self) -> None:
        """Close the journal in a forked process, so that its lock is released when the process of the writer dies."""
        descriptor, self.descriptor = self.descriptor, -1
        if descriptor >= 0:
            os.close(descriptor)

    def _refusal(self, error: OSError, size: int) -> StorageError:
        try:
            os.ftruncate(self.descriptor, self._end)
            free = os.fstatvfs(self.descriptor)
            room = f"{size} more bytes needed, {free.f_bavail * free.f_frsize} free"
        except OSError:  # if the disk is gone, this fails, too
            room = f"{size} more bytes needed"
        return StorageError(
            f"cannot record to {self.path}: {error.strerror} ({room}); everything recorded before is intact"
        )
