"""Opening of untrusted files, which must be ordinary files: never a link, a device, a pipe or a folder.

A dataset is a folder of ordinary files. A link in a dataset could make a command read or write any other file of the
user, and a named pipe or device could make a command wait or read for ever.
"""

import os
import stat
from pathlib import Path

from svfl_data.errors import FormatError


def open_regular(path: Path, flags: int = os.O_RDONLY, mode: int = 0o644) -> int:
    """Open an ordinary file, and return its descriptor, which the caller closes.

    Args:
        path: Path of the file. Folders on the way to the file may be links, the file itself may not.
        flags: Flags of `os.open`, such as ``os.O_RDONLY`` or ``os.O_WRONLY | os.O_APPEND | os.O_CREAT``.
        mode: Permissions of the file if this call creates it.

    Returns:
        The descriptor, which child processes do not inherit.

    Raises:
        FormatError: If the path is a link, or leads to a folder, pipe or device.
        OSError: If the file cannot be opened for another reason, such as FileNotFoundError. The system also refuses in
            this way to open a socket, and to open a folder, or a pipe without a reader, for writing.
    """
    refuse_link(path)
    # Without O_NONBLOCK, opening a named pipe waits for its other end; for ordinary files the flag means nothing.
    descriptor = os.open(path, flags | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC, mode)
    kind = os.fstat(descriptor).st_mode
    if not stat.S_ISREG(kind):
        os.close(descriptor)
        raise FormatError(f"{path}: {kind_words(kind)}, not an ordinary file; it was not read")
    return descriptor


def refuse_link(path: Path) -> None:
    """Raise an error if a path is a symbolic link, wherever the link leads.

    Raises:
        FormatError: If the path is a symbolic link.
    """
    if path.is_symlink():
        raise FormatError(f"{path}: a symbolic link; links inside a dataset are not followed, put the file itself here")


def read_regular(path: Path, limit: int) -> bytes:
    """Return the content of an ordinary file of limited size.

    Args:
        path: Path of the file, as for `open_regular`.
        limit: Largest allowed size of the file, [bytes].

    Raises:
        FormatError: If the file is not an ordinary file, or is larger than the limit.
        OSError: If the file cannot be opened or read.
    """
    descriptor = open_regular(path)
    with os.fdopen(descriptor, "rb") as file:
        content = file.read(limit + 1)
    if len(content) > limit:
        raise FormatError(f"{path}: larger than the {limit} bytes that such a file may have")
    return content


def kind_words(kind: int) -> str:
    """Return in words what kind of file something is that is not an ordinary file, such as ``a named pipe``.

    Args:
        kind: The `st_mode` of the result of `os.stat` for the file.
    """
    names = {stat.S_IFDIR: "a folder", stat.S_IFIFO: "a named pipe", stat.S_IFSOCK: "a socket"}
    return names.get(stat.S_IFMT(kind), "a device")
