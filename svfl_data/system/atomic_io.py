"""Writing of files that are either complete or unchanged, whatever interrupts the writer.

The new content is written to a temporary file, synced to disk, and only then renamed to the final name. The temporary
file lies in the same folder, and so in the same file system, as ``.NAME.*.part``. It is locked while its writer lives.
The kernel releases the lock when the process ends, which distinguishes the leftover of a killed writer from a file that
is being written.
"""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from svfl_data.errors import StorageError
from svfl_data.system.leftovers import file_aside


def write_atomically(path: Path, content: bytes, replace: bool = True) -> None:
    """Write a file under a temporary name, sync it to disk and rename it into place.

    Args:
        path: Final path of the file.
        content: Complete content of the file.
        replace: Whether an existing file is replaced. If False, an existing file is an error.

    Raises:
        StorageError: If the disk is full, read-only or otherwise refuses the write, or if the file exists and must not
            be replaced. No temporary file is left behind.
    """
    with written_aside(path, len(content), replace) as file:
        file.write(content)


@contextmanager
def written_aside(path: Path, size: int | None = None, replace: bool = True) -> Iterator[BinaryIO]:
    """Yield a temporary file that takes its final name at the end of the block, unless the block fails.

    Args:
        path: Final path of the file.
        size: Number of bytes that the file will have, for the error message. None if it is not known.
        replace: Whether an existing file is replaced. If False, an existing file is an error.

    Yields:
        The empty temporary file, opened for reading and writing in binary mode.

    Raises:
        StorageError: If the disk is full, read-only or otherwise refuses the write, also inside the block, or if the
            file exists and must not be replaced. No temporary file is left behind.
    """
    with named_aside(path, size, replace) as part, part.open("r+b") as file:
        yield file


@contextmanager
def named_aside(path: Path, size: int | None = None, replace: bool = True) -> Iterator[Path]:
    """Yield the path of a temporary file that takes its final name at the end of the block, unless the block fails.

    This is `written_aside` for code that opens the file by its path.

    Args:
        path: Final path of the file.
        size: Number of bytes that the file will have, for the error message. None if it is not known.
        replace: Whether an existing file is replaced. If False, an existing file is an error.

    Yields:
        Path of the empty temporary file. The block writes into this file and must not replace it by another file.

    Raises:
        StorageError: As for `written_aside`.
    """
    part = None
    try:
        if path.exists() and not path.is_file():
            raise FileExistsError(errno.EEXIST, "it is no ordinary file")
        descriptor, part = file_aside(path)
        try:  # the file is locked until it has its name, so that nobody takes it for a leftover
            yield part
            os.fsync(descriptor)
            os.fchmod(descriptor, 0o644)
            if replace:
                os.replace(part, path)
            else:
                name_unless_taken(part, path)
        finally:
            os.close(descriptor)
        sync_folder(path.parent)
    except OSError as error:
        bytes_ = "" if size is None else f" ({size} bytes)"
        raise StorageError(
            f"cannot write {path}{bytes_}: {error.strerror or error}; everything written before is intact"
        ) from error
    finally:
        if part:
            part.unlink(missing_ok=True)


def name_unless_taken(file: Path, path: Path) -> None:
    """Give a file its final name, unless that name is taken.

    Args:
        file: Present path of the file. The file may keep this name as a second name.
        path: Final path of the file.

    Raises:
        FileExistsError: If the final name is taken. Nothing is changed in that case.
        OSError: If the disk refuses the change.
    """
    try:
        os.link(file, path)
    except OSError as error:
        if error.errno not in (errno.EPERM, errno.EOPNOTSUPP, errno.ENOSYS):
            raise
        if path.exists():  # without hard links, two processes that come at the same instant both succeed
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(path)) from error
        os.replace(file, path)


def sync_folder(folder: Path) -> None:
    """Sync the names in a folder to disk, so that a rename inside the folder survives a power cut."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)  # the rename itself survives a power cut
    finally:
        os.close(descriptor)
