"""Temporary files and folders, and the removal of those that killed writers have left behind.

A process that writes under a temporary name holds a lock on the file or folder until it has its final name. The kernel
releases the lock when the process dies. So a temporary file or folder that another process can lock is a leftover,
however new it is.
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
"""Part of the name of every temporary folder. A folder without it is never removed."""
_FILE = re.compile(r"\..+\.part")
_FOLDER = re.compile(rf"\..+{re.escape(FOLDER_MARK)}\w+\.part")


def file_aside(path: Path) -> tuple[int, Path]:
    """Create a locked temporary file in the folder of its final path.

    Args:
        path: Final path of the file.

    Returns:
        Descriptor and path of the temporary file. The caller closes the descriptor after the file has got its final
        name.

    Raises:
        OSError: If the disk refuses to create the file.
    """
    while True:
        descriptor, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=SUFFIX)
        if _hold(descriptor):
            return descriptor, Path(name)
        os.close(descriptor)  # another process removed the file between creation and lock


@contextmanager
def folder_aside(path: Path) -> Iterator[Path]:
    """Yield a new, locked temporary folder, and remove it at the end of the block unless it was renamed.

    Args:
        path: Final path of the folder. The temporary folder lies beside it.

    Raises:
        OSError: If the disk refuses to create the folder.
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
    """Remove the temporary files that killed writers have left in the folder of a dataset.

    Files that cannot be removed stay.

    Returns:
        Paths of the removed files.
    """
    return [path for path in _listed(folder) if _FILE.fullmatch(path.name) and not path.is_dir() and _cleared(path)]


def clear_folders(parent: Path) -> list[Path]:
    """Remove the temporary folders that killed writers have left in a folder.

    Folders that cannot be removed stay.

    Args:
        parent: Folder in which the temporary folders lie, beside the final path of the folder that was being made.

    Returns:
        Paths of the removed folders.
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
    except (OSError, FormatError):  # a link, gone meanwhile, another user's, or not a temporary file
        return False
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)  # fails while the writer lives
        shutil.rmtree(path) if whole else path.unlink()
    except OSError:
        return False
    finally:
        os.close(descriptor)
    return True


def _hold(descriptor: int) -> bool:
    """Lock a file or folder that was just created, and return whether it still has a name."""
    with suppress(OSError):  # without locks on this file system, nobody can take it for a leftover either
        fcntl.flock(descriptor, fcntl.LOCK_EX)
    return os.fstat(descriptor).st_nlink > 0
