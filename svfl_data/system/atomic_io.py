"""Files that are either whole or as they were before: written aside, synced to disk, and only then given their name.

What is written aside lies in the same folder, so in the same file system, as ``.NAME.*.part``, and is locked while its
writer lives: the kernel drops the lock with the process, and that tells a leftover from a file that is being written.
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
    """Write a file aside, sync it to disk and rename it into place.

    Args:
        path: The file.
        content: Its bytes.
        replace: Whether it may exist, and is replaced then.

    Raises:
        StorageError: If the disk is full, read-only or otherwise refuses, or the file exists and must not be replaced;
            nothing is left behind.
    """
    with written_aside(path, len(content), replace) as file:
        file.write(content)


@contextmanager
def written_aside(path: Path, size: int | None = None, replace: bool = True) -> Iterator[BinaryIO]:
    """A file beside another that takes its name at the end of the block, unless the block fails.

    Args:
        path: The file.
        size: Bytes that it will have, for the message; None if that is not known.
        replace: Whether it may exist, and is replaced then.

    Raises:
        StorageError: If the disk is full, read-only or otherwise refuses, in the block, too, or the file exists and
            must not be replaced; nothing is left behind.
    """
    with named_aside(path, size, replace) as part, part.open("r+b") as file:
        yield file


@contextmanager
def named_aside(path: Path, size: int | None = None, replace: bool = True) -> Iterator[Path]:
    """As `written_aside`, for those who write to a file by its name: an empty file, which they must not replace.

    Raises:
        StorageError: As `written_aside`.
    """
    part = None
    try:
        if path.exists() and not path.is_file():
            raise FileExistsError(errno.EEXIST, "it is no ordinary file")
        descriptor, part = file_aside(path)
        try:  # locked until it has its name: nobody takes it for a leftover
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
    """Give a file its final name; it may keep its other one, too.

    Raises:
        FileExistsError: If the name is taken; nothing is changed.
        OSError: If the disk refuses.
    """
    try:
        os.link(file, path)
    except OSError as error:
        if error.errno not in (errno.EPERM, errno.EOPNOTSUPP, errno.ENOSYS):
            raise
        if path.exists():  # a file system without links, on which two that come in the same instant both succeed
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(path)) from error
        os.replace(file, path)


def sync_folder(folder: Path) -> None:
    """Have the disk take a folder's names."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)  # the rename itself survives a power cut
    finally:
        os.close(descriptor)
