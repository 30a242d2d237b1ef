"""The seal behind an episode's HDF5 content: a SHA-256 of all bytes before it, checked before HDF5 sees any of them."""

import hashlib
import os
from pathlib import Path

from svfl_data.errors import FormatError

SEAL_MARK = b"\nsvfl-sha256:"
SEAL_SIZE = len(SEAL_MARK) + 64 + 1  # a hexadecimal SHA-256 and the line's end
HDF5_MAGIC = b"\x89HDF\r\n\x1a\n"
BLOCK = 2**20  # bytes read at once


def seal(content: bytes) -> bytes:
    """The seal of some content."""
    return _seal_of(hashlib.sha256(content).hexdigest())


def file_seal(descriptor: int, size: int) -> bytes:
    """The seal of the first bytes of an open file; memory holds a block at a time."""
    digest = hashlib.sha256()
    for start in range(0, size, BLOCK):
        digest.update(os.pread(descriptor, min(BLOCK, size - start), start))
    return _seal_of(digest.hexdigest())


def _seal_of(digest: str) -> bytes:
    return SEAL_MARK + digest.encode() + b"\n"


def check_seal(path: Path) -> None:
    """Check that a file is what was sealed, whatever its size; memory holds a block at a time.

    Raises:
        FormatError: If it is not, or cannot be read.
    """
    try:
        with path.open("rb") as file:
            size = os.fstat(file.fileno()).st_size
            expected = file_seal(file.fileno(), max(0, size - SEAL_SIZE))
            found = os.pread(file.fileno(), SEAL_SIZE, max(0, size - SEAL_SIZE))
            head = os.pread(file.fileno(), len(HDF5_MAGIC), 0)
    except OSError as error:
        raise FormatError(f"{path}: cannot be read ({error.strerror})") from error
    if found != expected:
        raise broken(path, head, found, size)


def has_seal(path: Path) -> bool:
    """Whether a file ends as a sealed one does, intact or not; one that other software has changed does not."""
    with path.open("rb") as file:
        file.seek(max(0, os.fstat(file.fileno()).st_size - SEAL_SIZE))
        return file.read(len(SEAL_MARK)) == SEAL_MARK


def broken(where: object, head: bytes, found: bytes, size: int) -> FormatError:
    """What is wrong with an episode that is not what was sealed.

    Args:
        where: It lies, for the message.
        head: Its first bytes, as many as `HDF5_MAGIC` has.
        found: Its last bytes, as many as a seal has.
        size: Number of its bytes.
    """
    if head != HDF5_MAGIC:
        return FormatError(f"{where}: not an episode file (no HDF5 file, {size} bytes)")
    if found.startswith(SEAL_MARK):
        return FormatError(f"{where}: damaged (its {size} bytes do not match its seal)")
    return FormatError(
        f"{where}: not a sealed episode: truncated, or written by other software ({size} bytes); "
        "an episode that was edited is sealed again by svfl-data repair --reseal"
    )
