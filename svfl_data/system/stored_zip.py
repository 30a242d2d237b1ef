"""Reading of ZIP archives with uncompressed members: replay buffers, checkpoints and exported programs.

The size that the members claim is limited by the size of the file, because no member is compressed and the members
together must not be larger than the file.
"""

import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO, cast

from svfl_data.system.regular_file import open_regular

FIRST = b"PK\x03\x04"
"""Bytes with which the first member begins. If other bytes stood before them, zipfile would skip these, and other
programs might read them."""


class Stored:
    """An open archive whose members have been checked.

    Args:
        file: Archive that is opened for reading in binary mode, at any position. The caller closes it.

    Attributes:
        file: The file that was given as `file`.
        members: Size of each member by name, [bytes].

    Raises:
        zipfile.BadZipFile: If the file is not an archive, or if its members are compressed, encrypted, repeated, oddly
            named, or larger than the file together.
    """

    def __init__(self, file: BinaryIO) -> None:
        file.seek(0)
        if file.read(len(FIRST)) != FIRST:
            raise zipfile.BadZipFile("does not begin with the signature of a ZIP archive")
        self.file, self._archive = file, zipfile.ZipFile(file)
        found = self._archive.infolist()
        for member in found:
            _check(member)
        self.members = {member.filename: member.file_size for member in found}
        if len(self.members) < len(found):
            raise zipfile.BadZipFile("has two members of the same name")
        if sum(self.members.values()) > file.seek(0, 2):
            raise zipfile.BadZipFile("its members together are larger than the file")
        file.seek(0)

    def read(self, name: str) -> bytes:
        """Return the content of a member, whose CRC is checked.

        Raises:
            KeyError: If there is no member of this name.
            zipfile.BadZipFile: If the member is damaged.
        """
        return self._archive.read(name)


@contextmanager
def stored(path: Path) -> Iterator[Stored]:
    """Open a ZIP archive of uncompressed members, and yield it until the end of the block.

    Args:
        path: Path of an ordinary file, or of a link to one, because a user may name a model by a link.

    Raises:
        FormatError: If the path does not lead to an ordinary file.
        OSError: If the file cannot be opened or read.
        zipfile.BadZipFile: As for `Stored`.
    """
    with open(open_regular(path.resolve()), "rb") as file:
        yield Stored(cast(BinaryIO, file))


def _check(member: zipfile.ZipInfo) -> None:
    name = member.filename
    if member.compress_type != zipfile.ZIP_STORED or member.compress_size != member.file_size:
        raise zipfile.BadZipFile(f"{name} is compressed")
    if member.flag_bits & 1:
        raise zipfile.BadZipFile(f"{name} is encrypted")
    if leads_out(name):
        raise zipfile.BadZipFile(f"{name!r} is not allowed as the name of a member")


def leads_out(name: str) -> bool:
    """Return whether a member of this name would be unpacked to a place outside the target folder."""
    return name.startswith("/") or name[1:2] == ":" or "\\" in name or ".." in name.split("/")
