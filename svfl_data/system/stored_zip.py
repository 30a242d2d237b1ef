"""ZIP archives of members that are stored as they are: replay buffers, checkpoints and exported programs.

What a member may claim to hold is bounded by the size of the file: nothing is compressed, and no bytes are given twice.
"""

import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO, cast

from svfl_data.system.regular_file import open_regular

FIRST = b"PK\x03\x04"
"""How the first member begins. What stands before it, zipfile would skip and others might read."""


class Stored:
    """An open archive whose members have been checked.

    Args:
        file: Positioned anywhere; stays the caller's.

    Attributes:
        file: The same.
        members: Sizes by name, [bytes].

    Raises:
        zipfile.BadZipFile: If it is no archive, or one with compressed, encrypted, overlapping, repeated or oddly named
            members.
    """

    def __init__(self, file: BinaryIO) -> None:
        file.seek(0)
        if file.read(len(FIRST)) != FIRST:
            raise zipfile.BadZipFile("does not begin as an archive does")
        self.file, self._archive = file, zipfile.ZipFile(file)
        found = self._archive.infolist()
        for member in found:
            _check(member)
        self.members = {member.filename: member.file_size for member in found}
        if len(self.members) < len(found):
            raise zipfile.BadZipFile("has two members of the same name")
        if sum(self.members.values()) > file.seek(0, 2):
            raise zipfile.BadZipFile("its members are larger than the file together")
        file.seek(0)

    def read(self, name: str) -> bytes:
        """The content of a member, its CRC checked.

        Raises:
            KeyError: If there is none of this name.
            zipfile.BadZipFile: If it is damaged.
        """
        return self._archive.read(name)


@contextmanager
def stored(path: Path) -> Iterator[Stored]:
    """Open such a file.

    Args:
        path: An ordinary file, or a link to one: whoever names a model may do so by a link.

    Raises:
        FormatError: If it is no ordinary file.
        OSError: If it cannot be opened or read.
        zipfile.BadZipFile: As `Stored`.
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
        raise zipfile.BadZipFile(f"{name!r} is no name of a member")


def leads_out(name: str) -> bool:
    """Whether a member of this name would lie outside the folder that somebody unpacks the archive into."""
    return name.startswith("/") or name[1:2] == ":" or "\\" in name or ".." in name.split("/")
