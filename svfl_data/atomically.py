"""Files that are either whole or as they were before: written aside, synced to disk, and only then given their name."""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from svfl_data.errors import StorageError
from svfl_data.leftovers import file_aside


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
    aside = None
    try:
        handle, aside = file_aside(path)
        with os.fdopen(handle, "wb") as file:  # locked until it has its name: nobody takes it for a leftover
            yield file
            file.flush()
            os.fsync(file.fileno())
            os.chmod(aside, 0o644)
            if replace:
                os.replace(aside, path)
            else:
                name_unless_taken(aside, path)
        sync_folder(path.parent)
    except OSError as error:
        bytes_ = "" if size is None else f" ({size} bytes)"
        raise StorageError(
            f"cannot write {path}{bytes_}: {error.strerror}; everything written before is intact"
        ) from error
    finally:
        if aside:
            aside.unlink(missing_ok=True)


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
