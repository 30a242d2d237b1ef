"""A file for the HDF5 library whose writes never fail.

The library crashes the process when the disk refuses a write (measured: h5py 3.12 and 3.16 on a full tmpfs, 8 of 8).
So what the disk refuses is kept in memory until the library has closed its file; the error surfaces after that.
"""

import io
import os


class Sink(io.RawIOBase):
    """The new file behind a descriptor, as h5py wants file objects.

    Attributes:
        error: The first refusal of the disk, or another reason to stop that was set from outside. Whoever writes looks
            at it now and then, stops, closes and raises it; until then every write takes memory.
    """

    def __init__(self, descriptor: int) -> None:
        self.error: BaseException | None = None
        self._descriptor = descriptor
        self._position = 0
        self._end = 0
        self._refused: list[tuple[int, bytes]] = []

    def write(self, data) -> int:  # type: ignore[no-untyped-def]  # noqa: ANN001 - any buffer
        """Write at the position; always the whole of it, to the disk or else to memory."""
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
        """Read at the position what was written there, whether or not the disk took it."""
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
        """Move the position."""
        self._position = offset + (0, self._position, self._end)[whence]
        return self._position

    def tell(self) -> int:
        """The position."""
        return self._position

    def truncate(self, size: int | None = None) -> int:
        """Set the size."""
        self._end = self._position if size is None else size
        try:
            os.ftruncate(self._descriptor, self._end)
        except OSError as error:
            self.error = self.error or error
        return self._end

    def seekable(self) -> bool:
        """Always."""
        return True

    def readable(self) -> bool:
        """Always."""
        return True

    def writable(self) -> bool:
        """Always."""
        return True


def write_all(descriptor: int, view: memoryview, offset: int) -> None:
    """Write all of a buffer at an offset.

    Raises:
        OSError: If the disk refuses, possibly after a part of it.
    """
    while view:
        written = os.pwrite(descriptor, view, offset)
        view, offset = view[written:], offset + written
