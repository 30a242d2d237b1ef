"""The folder of a dataset during recording: it is locked, and must stay the same folder under the same name."""

import fcntl
import os
from pathlib import Path

from svfl_data.errors import StorageError
from svfl_data.system.own_process import OwnProcess

Identity = tuple[int, int]
"""Device and inode number of a folder, which distinguish two folders of the same name."""


def identity(path: Path) -> Identity | None:
    """Return the identity of the folder that has a name at present, or None if there is none."""
    try:
        found = os.stat(path)
    except OSError:
        return None
    return found.st_dev, found.st_ino


def check_same(path: Path, expected: Identity) -> None:
    """Raise an error if a path leads to another folder than before.

    Args:
        path: Path of the folder.
        expected: Identity that the folder had before.

    Raises:
        StorageError: If the folder is gone or is another one.
    """
    if identity(path) != expected:
        raise StorageError(f"{path}: the folder was removed or renamed while it was being recorded into")


class HeldFolder(OwnProcess):
    """An open folder, which can be recognised and found after it was renamed.

    Attributes:
        path: Path under which the folder was opened.

    Args:
        path: Path of the folder.

    Raises:
        StorageError: If the folder cannot be opened.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._descriptor = -1  # before anything can fail
        try:
            self._descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        except OSError as error:
            raise StorageError(f"cannot open {path}: {error.strerror}") from error

    @property
    def identity(self) -> Identity:
        """Device and inode number of the open folder."""
        found = os.fstat(self._descriptor)
        return found.st_dev, found.st_ino

    @property
    def in_place(self) -> bool:
        """Whether the folder still has the name under which it was opened."""
        return identity(self.path) == self.identity

    def lock(self) -> bool:
        """Lock the folder for this process alone, until the folder is closed or the process dies.

        Returns:
            Whether the folder is locked now. False if another process holds the lock.

        Raises:
            StorageError: If the file system refuses the lock.
        """
        try:
            fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        except OSError as error:
            raise StorageError(f"cannot lock {self.path}: {error.strerror}") from error
        return True

    def check(self) -> None:
        """Raise an error if the folder has lost the name under which it was opened.

        Raises:
            StorageError: If the folder was removed or renamed. The message says where the folder is now, if that can be
                found out.
        """
        if not self.in_place:
            raise StorageError(
                f"{self.path}: the folder was removed or renamed while it was being recorded into; {self._where()}"
            )

    def _where(self) -> str:
        try:
            now = os.readlink(f"/proc/self/fd/{self._descriptor}")  # Linux
        except OSError:
            return "what was recorded before lies where it is now"
        if now.endswith(" (deleted)") or identity(Path(now)) != self.identity:
            return "it was deleted, with everything in it"
        return f"what was recorded before is in {now} (unfinished episodes: svfl-data repair {now})"

    def close(self) -> None:
        """Close the folder, which releases its lock."""
        if self._descriptor >= 0 and self.in_own_process:
            os.close(self._descriptor)
            self._descriptor = -1

    def forked(self) -> None:
        """Close the folder in a fork of the process, which must not hold it."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1
