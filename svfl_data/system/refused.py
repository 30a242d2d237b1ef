"""One-line messages for errors of the operating system: the file, the system's message, and what the user can do."""

import errno
import os

ROOM = "free some space, or write to another disk"
POSSIBLE = {
    errno.EACCES: "ask its owner for the permission, or choose another place",
    errno.EPERM: "ask its owner for the permission, or choose another place",
    errno.EDQUOT: f"your share of the disk is used up: {ROOM}",
    errno.EIO: "the disk or its connection fails: copy elsewhere what matters, then check it",
    errno.EMFILE: "raise the limit of open files (ulimit -n 4096), or use fewer workers",
    errno.ENFILE: "the whole machine has too many open files: end other programs",
    errno.ENOLCK: "this file system has no locks, as some NFS mounts: use a folder on a local disk",
    errno.ENOMEM: "end other programs, or use fewer workers",
    errno.ENOSPC: ROOM,
    errno.EROFS: "this file system is read-only: choose another place",
    errno.ESTALE: "the network disk lost the file: run the command again once it is back",
    errno.ETIMEDOUT: "the network disk does not answer: run the command again once it is back",
}
"""What a user can do about an error of the operating system, by its error number."""


def refusal(error: OSError, what: str = "") -> str:
    """Return the one-line message for an error of the operating system.

    Args:
        error: Error that the operating system raised.
        what: Name of what was being used, such as ``standard output``. It is used only if the error names no file.

    Returns:
        The message, such as ``data/a.hdf5: Read-only file system; this file system is read-only: choose another
        place``.
    """
    names = [os.fsdecode(name) for name in (error.filename, error.filename2) if isinstance(name, str | bytes)]
    where = " -> ".join(names) or what
    says = error.strerror or str(error) or type(error).__name__
    possible = POSSIBLE.get(error.errno or 0)
    return (f"{where}: " if where else "") + says + (f"; {possible}" if possible else "")
