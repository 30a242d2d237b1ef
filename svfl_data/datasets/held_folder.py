"""A dataset's folder that is being recorded into: it must stay the same folder, under the same name."""

import fcntl
import os
from pathlib import Path

from svfl_data.errors import StorageError
from svfl_data.system.own_process import OwnProcess

Identity = tuple[int, int]
"""Device and number of a folder, by which two folders of one name are told apart."""


def identity(path: Path) -> Identity | None:
    """Which folder has this name now; None if there is none."""
    try:
        found = os.stat(path)
    except OSError:
        return None
    return found.st_dev, found.st_ino


def check_same(path: Path, expected: Identity) -> None:
    """Refuse to go on in another folder than before.

    Raises:
        StorageError: If the folder is gone or is another one.
    """
    if identity(path) != expected:
        raise StorageError(f"{path}: the folder was removed or renamed while it was being recorded into")


class HeldFolder(OwnProcess):
    """An open folder, so that it is known again, and can be found after it was renamed.

    Attributes:
        path: The name under which it was opened.

    Args:
        path: The folder.

    Raises:
        StorageError: If it cannot be opened.
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
        """Which folder it is."""
        found = os.fstat(self._descriptor)
        return found.st_dev, found.st_ino

    @property
    def in_place(self) -> bool:
        """Whether it still has its name."""
        return identity(self.path) == self.identity

    def lock(self) -> bool:
        """Hold it for this process alone, until it is closed or the process dies; False if another one does.

        Raises:
            StorageError: If the file system refuses.
        """
        try:
            fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        except OSError as error:
            raise StorageError(f"cannot lock {self.path}: {error.strerror}") from error
        return True

    def check(self) -> None:
        """Refuse to go on if the folder has lost its name.

        Raises:
            StorageError: If it was removed or renamed; says where it is now, if that can be found out.
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
        """Let it go."""
        if self._descriptor >= 0 and self.in_own_process:
            os.close(self._descriptor)
            self._descriptor = -1

    def forked(self) -> None:
        """A fork of the process does not hold it."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1
