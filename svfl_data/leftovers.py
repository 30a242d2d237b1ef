"""Files that are written aside, told from what killed writers have left: by a lock that lives as long as the writer.

Whoever writes aside holds a lock on what it writes until that has its final name; the kernel drops the lock when the
process dies. What can be locked by somebody else is a leftover, however new it is.
"""

import fcntl
import os
import re
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

SUFFIX = ".part"
FOLDER_MARK = ".svfl-"
"""Part of the name of a folder that is written aside; folders of other names are nobody's to remove."""
_FILE = re.compile(r"\..+\.part")
_FOLDER = re.compile(rf"\..+{re.escape(FOLDER_MARK)}\w+\.part")


def file_aside(path: Path) -> tuple[int, Path]:
    """A new, locked file beside another one.

    Returns:
        Its descriptor, to be closed after it has got its final name, and its path.

    Raises:
        OSError: If the disk refuses.
    """
    while True:
        descriptor, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=SUFFIX)
        if _hold(descriptor):
            return descriptor, Path(name)
        os.close(descriptor)  # somebody who was clearing came between creation and lock


@contextmanager
def folder_aside(path: Path) -> Iterator[Path]:
    """A new, locked folder beside another one; removed at the end of the block unless it was renamed.

    Raises:
        OSError: If the disk refuses.
    """
    while True:
        folder = Path(tempfile.mkdtemp(dir=path.parent, prefix=f".{path.name}{FOLDER_MARK}", suffix=SUFFIX))
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        if _hold(descriptor) and folder.exists():
            break
        os.close(descriptor)
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        os.close(descriptor)


def clear_files(folder: Path) -> None:
    """Remove files that killed writers have left in a dataset's folder; what cannot be removed stays."""
    with suppress(OSError), os.scandir(folder) as listing:
        for item in listing:
            if _FILE.fullmatch(item.name) and not item.is_dir(follow_symlinks=False):
                _clear(Path(item.path), Path.unlink)


def clear_folders(parent: Path) -> None:
    """Remove folders that killed writers have left beside the one that they were making; what cannot be stays."""
    with suppress(OSError), os.scandir(parent) as listing:
        for item in listing:
            if _FOLDER.fullmatch(item.name) and item.is_dir(follow_symlinks=False):
                _clear(Path(item.path), shutil.rmtree)


def _clear(path: Path, remove: Callable[[Path], object]) -> None:
    with suppress(OSError):
        descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)  # refused while the writer lives
            remove(path)
        finally:
            os.close(descriptor)


def _hold(descriptor: int) -> bool:
    """Lock what was just created; whether it still has a name then."""
    with suppress(OSError):  # a file system without locks, where nobody can take it for a leftover either
        fcntl.flock(descriptor, fcntl.LOCK_EX)
    return os.fstat(descriptor).st_nlink > 0
