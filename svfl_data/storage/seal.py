"""The seal at the end of an episode file: a SHA-256 of all bytes before it.

The seal is checked before HDF5 reads any of these bytes.
"""

import hashlib
import os
from pathlib import Path

from svfl_data.errors import FormatError

SEAL_MARK = b"\nsvfl-sha256:"
SEAL_SIZE = len(SEAL_MARK) + 64 + 1  # a hexadecimal SHA-256 and the line's end
HDF5_MAGIC = b"\x89HDF\r\n\x1a\n"
BLOCK = 2**20  # bytes read at once


def seal(content: bytes) -> bytes:
    """Return the seal that belongs behind the given content."""
    return _seal_of(hashlib.sha256(content).hexdigest())


def file_seal(descriptor: int, size: int) -> bytes:
    """Compute the seal of the first bytes of an open file, with one block in memory at a time.

    Args:
        descriptor: File descriptor, open for reading.
        size: Number of bytes to hash, counted from the beginning of the file.
    """
    digest = hashlib.sha256()
    for start in range(0, size, BLOCK):
        digest.update(os.pread(descriptor, min(BLOCK, size - start), start))
    return _seal_of(digest.hexdigest())


def _seal_of(digest: str) -> bytes:
    return SEAL_MARK + digest.encode() + b"\n"


def check_seal(path: Path) -> None:
    """Check that the content of a file matches its seal, with one block of the file in memory at a time.

    Raises:
        FormatError: If the content does not match the seal, or the file cannot be read.
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
    """Return whether a file ends with a seal, whether or not its content is intact.

    A file that other software has changed does not end with a seal any more.
    """
    with path.open("rb") as file:
        file.seek(max(0, os.fstat(file.fileno()).st_size - SEAL_SIZE))
        return file.read(len(SEAL_MARK)) == SEAL_MARK


def broken(where: object, head: bytes, found: bytes, size: int) -> FormatError:
    """Return the error that describes an episode file whose content does not match its seal.

    Args:
        where: Place of the episode, such as the path of its file, for the message.
        head: First bytes of the file, as many as `HDF5_MAGIC` has.
        found: Last bytes of the file, as many as a seal has.
        size: Size of the file, [bytes].
    """
    if head != HDF5_MAGIC:
        return FormatError(f"{where}: not an episode file (no HDF5 file, {size} bytes)")
    if found.startswith(SEAL_MARK):
        return FormatError(f"{where}: damaged (its {size} bytes do not match its seal)")
    return FormatError(
        f"{where}: not a sealed episode: truncated, or written by other software ({size} bytes); "
        "an episode that was edited is sealed again by svfl-data repair --reseal"
    )
