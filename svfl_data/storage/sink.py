"""A file object for the HDF5 library whose writes never fail.

The HDF5 library crashes the process when the disk refuses a write (measured with h5py 3.12 and 3.16 on a full tmpfs: 8
of 8 times). So bytes that the disk refuses are kept in memory until the library has closed its file. The error is
raised after that.
"""

import io
import os


class Sink(io.RawIOBase):
    """A new file, given by its descriptor, as a file object that h5py accepts.

    Attributes:
        error: First error of the disk, or another reason to stop that was set from outside; None while there is none.
            The code that writes must look at this attribute regularly, then stop, close the HDF5 file and raise the
            error. Until then every further write takes memory.
    """

    def __init__(self, descriptor: int) -> None:
        self.error: BaseException | None = None
        self._descriptor = descriptor
        self._position = 0
        self._end = 0
        self._refused: list[tuple[int, bytes]] = []

    def write(self, data) -> int:  # type: ignore[no-untyped-def]  # noqa: ANN001 - any buffer
        """Write a whole buffer at the current position, to the disk or, if the disk refuses, to memory."""
        view = memoryview(data).cast("B")
        try:
            if self.error is None:
                write_all(self._descriptor, view, self._position)
        except OSError as error:
            self.error = error
        if self.error is not None:
            self._refused.append((self._position, bytes(view)))
        self._position += len(view)
        self._end = max(self._end, self._position)
        return len(view)

    def readinto(self, buffer) -> int:  # type: ignore[no-untyped-def]  # noqa: ANN001 - any buffer
        """Read the bytes at the current position, on disk or in memory, into a buffer, and return their number."""
        view = memoryview(buffer).cast("B")
        start, stop = self._position, min(self._position + len(view), self._end)
        count = max(0, stop - start)
        stored = os.pread(self._descriptor, count, start)
        view[:count] = stored + bytes(count - len(stored))
        for offset, data in self._refused:
            low, high = max(start, offset), min(stop, offset + len(data))
            if low < high:
                view[low - start : high - start] = data[low - offset : high - offset]
        self._position += count
        return count

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Move the current position, and return the new one."""
        self._position = offset + (0, self._position, self._end)[whence]
        return self._position

    def tell(self) -> int:
        """Return the current position."""
        return self._position

    def truncate(self, size: int | None = None) -> int:
        """Set the size of the file, by default to the current position, and return the new size."""
        self._end = self._position if size is None else size
        try:
            os.ftruncate(self._descriptor, self._end)
        except OSError as error:
            self.error = self.error or error
        return self._end

    def seekable(self) -> bool:
        """Return True, since the position can always be moved."""
        return True

    def readable(self) -> bool:
        """Return True, since the file can always be read."""
        return True

    def writable(self) -> bool:
        """Return True, since the file can always be written."""
        return True


def write_all(descriptor: int, view: memoryview, offset: int) -> None:
    """Write a whole buffer into a file at an offset.

    Args:
        descriptor: File descriptor, open for writing.
        view: Bytes to write.
        offset: Position of the first byte in the file, [bytes].

    Raises:
        OSError: If the disk refuses. A part of the buffer may have been written by then.
    """
    while view:
        written = os.pwrite(descriptor, view, offset)
        view, offset = view[written:], offset + written
