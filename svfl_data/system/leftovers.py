"""Files that are written aside, told from what killed writers have left: by a lock that lives as long as the writer.

Whoever writes aside holds a lock on what it writes until that has its final name; the kernel drops the lock when the
process dies. What can be locked by somebody else is a leftover, however new it is.
"""

import fcntl
import os
import re
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from svfl_data.errors import FormatError
from svfl_data.system.regular_file import open_regular

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


def clear_files(folder: Path) -> list[Path]:
    """Remove files that killed writers have left in a dataset's folder; what cannot be removed stays.

    Returns:
        What was removed.
    """
    return [path for path in _listed(folder) if _FILE.fullmatch(path.name) and not path.is_dir() and _cleared(path)]


def clear_folders(parent: Path) -> list[Path]:
    """Remove folders that killed writers have left beside the one that they were making; what cannot be stays.

    Returns:
        What was removed.
    """
    return [path for path in _listed(parent) if _FOLDER.fullmatch(path.name) and path.is_dir() and _cleared(path)]


def _listed(folder: Path) -> list[Path]:
    try:
        return sorted(folder.iterdir())
    except OSError:
        return []


def _cleared(path: Path) -> bool:
    whole = path.is_dir()
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW) if whole else open_regular(path)
    except (OSError, FormatError):  # a link, gone meanwhile, another user's, or nothing that was written aside
        return False
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)  # refused while the writer lives
        shutil.rmtree(path) if whole else path.unlink()
    except OSError:
        return False
    finally:
        os.close(descriptor)
    return True


def _hold(descriptor: int) -> bool:
    """Lock what was just created; whether it still has a name then."""
    with suppress(OSError):  # a file system without locks, where nobody can take it for a leftover either
        fcntl.flock(descriptor, fcntl.LOCK_EX)
    return os.fstat(descriptor).st_nlink > 0
