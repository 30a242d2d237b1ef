"""The file of a saved replay buffer: an uncompressed ZIP archive of NumPy arrays and one JSON text.

The file is written under a temporary name, synced and then renamed, so that a killed process leaves no partial file. It
is written one array at a time, to save memory. Every member has a CRC-32, which is checked before its content is used.
Equal buffers give equal bytes.
"""

import io
import math
import struct
import zipfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from svfl_data.errors import FormatError, UsageError
from svfl_data.schema.episode import canonical_json
from svfl_data.system.atomic_io import written_aside
from svfl_data.system.printable import printable
from svfl_data.system.side_files import check_format, parse_json
from svfl_data.system.stored_zip import Stored, stored

FORMAT = "svfl-replay"
FORMAT_VERSION = "2.0"
HEADER = "replay.json"
NPY_VERSION = (1, 0)
EARLIEST = (1980, 1, 1, 0, 0, 0)  # a constant: the time of writing would make the files of equal buffers differ
DAMAGE = (
    zipfile.BadZipFile, struct.error, OSError, EOFError, RuntimeError,
    ArithmeticError, AttributeError, LookupError, MemoryError, TypeError, ValueError, UsageError,
)  # fmt: skip
"""Exceptions that zipfile, json, NumPy and the buffer raise for a file that is damaged or not a saved buffer."""


def write(path: Path, header: dict[str, Any], arrays: Iterable[tuple[str, np.ndarray]]) -> None:
    """Write the file of a replay buffer; if writing fails, a file that existed before is unchanged.

    Args:
        path: File to write; replaced if it exists.
        header: JSON values by name.
        arrays: Name and content of each array.

    Raises:
        StorageError: If the file cannot be written. No partial file is left then.
    """
    with written_aside(path) as file, zipfile.ZipFile(file, "w", zipfile.ZIP_STORED) as archive:
        text = canonical_json({"format": FORMAT, "format_version": FORMAT_VERSION, **header})
        archive.writestr(zipfile.ZipInfo(HEADER, EARLIEST), text)
        for name, array in arrays:
            content = io.BytesIO()
            np.lib.format.write_array(content, np.asarray(array, order="C"), NPY_VERSION, allow_pickle=False)
            archive.writestr(zipfile.ZipInfo(f"{name}.npy", EARLIEST), content.getbuffer())


class Saved:
    """File of a saved replay buffer that is being read.

    Attributes:
        header: JSON values by name, as `write` stored them, with the format and its version.
    """

    def __init__(self, archive: Stored, header: dict[str, Any]) -> None:
        self._archive, self.header = archive, header

    def count(self, name: str) -> int:
        """Return a whole number of the header, at least 0.

        Args:
            name: Name of the number in the header.

        Raises:
            ValueError: If the value is not a whole number of at least 0.
        """
        value = self.header[name]
        if type(value) is not int or value < 0:
            raise ValueError(f"{name} is {value!r}")
        return value

    def array(self, name: str) -> np.ndarray:
        """Read an array; its declared size is checked against the size of its member before it is created.

        Args:
            name: Name of the array.

        Raises:
            ValueError: If the member is not an NPY array of version 1.0, or its size differs from the declared size.
        """
        content = self._archive.read(f"{name}.npy")
        opened = io.BytesIO(content)
        if np.lib.format.read_magic(opened) != NPY_VERSION:
            raise ValueError(f"{name} is no array of NPY version 1.0")
        shape, fortran_order, dtype = np.lib.format.read_array_header_1_0(opened)
        size, held = math.prod(shape) * dtype.itemsize, len(content) - opened.tell()
        if dtype.hasobject or fortran_order or size != held:
            raise ValueError(f"{name} is declared as {size} bytes of {dtype}, the file holds {held}")
        return np.frombuffer(content, dtype, offset=opened.tell()).reshape(shape)


@contextmanager
def reading(path: Path) -> Iterator[Saved]:
    """Open the file of a replay buffer for reading; errors while it is open are also raised as a `FormatError`.

    Args:
        path: File to read.

    Yields:
        The open file.

    Raises:
        FormatError: If the file is missing, damaged, not a saved replay buffer, or has another format version.
    """
    if not path.is_file():
        raise FormatError(f"{path}: {'not a file' if path.exists() else 'no such file'}")
    try:
        with stored(path) as archive:
            if HEADER not in archive.members:
                raise FormatError(f"{path}: a ZIP file, but not a saved replay buffer (it has no {HEADER})")
            content = archive.read(HEADER)
            header = parse_json(content, path, limit=len(content))
            check_format(header, FORMAT, FORMAT_VERSION, path, "not a saved replay buffer")
            yield Saved(archive, header)
    except DAMAGE as error:
        words = printable(" ".join(str(error).split()) or type(error).__name__, 200)
        raise FormatError(f"{path}: not a saved replay buffer, or damaged ({words})") from error
