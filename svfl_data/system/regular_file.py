"""Opening files that strangers may have put somewhere: never through a link, never a device, a pipe or a folder.

A dataset is a folder of ordinary files. A link in it could make a command read or write any other file of the user's,
and a named pipe or device could make it wait or read for ever.
"""

import os
import stat
from pathlib import Path

from svfl_data.errors import FormatError


def open_regular(path: Path, flags: int = os.O_RDONLY, mode: int = 0o644) -> int:
    """Open an ordinary file; the caller closes the descriptor.

    Args:
        path: The file. Folders on the way to it may be links, the file itself may not.
        flags: Of `os.open`, such as ``os.O_RDONLY`` or ``os.O_WRONLY | os.O_APPEND | os.O_CREAT``.
        mode: Permissions of a file that is created by it.

    Returns:
        A descriptor, which child processes do not inherit.

    Raises:
        FormatError: If there is a link, folder, pipe, socket or device of this name.
        OSError: If it cannot be opened for another reason, such as FileNotFoundError.
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
    """Refuse a path that is a symbolic link, whatever it leads to.

    Raises:
        FormatError: If it is one.
    """
    if path.is_symlink():
        raise FormatError(f"{path}: a symbolic link; links inside a dataset are not followed, put the file itself here")


def read_regular(path: Path, limit: int) -> bytes:
    """The content of an ordinary file of limited size.

    Args:
        path: The file; see `open_regular`.
        limit: Most bytes that it may have.

    Raises:
        FormatError: If it is no ordinary file, or larger than the limit.
        OSError: If it cannot be opened or read.
    """
    descriptor = open_regular(path)
    with os.fdopen(descriptor, "rb") as file:
        content = file.read(limit + 1)
    if len(content) > limit:
        raise FormatError(f"{path}: larger than the {limit} bytes that such a file may have")
    return content


def kind_words(kind: int) -> str:
    """What a file is that is no ordinary one, by the `st_mode` of its stat."""
    names = {stat.S_IFDIR: "a folder", stat.S_IFIFO: "a named pipe", stat.S_IFSOCK: "a socket"}
    return names.get(stat.S_IFMT(kind), "a device")
