"""Finding episodes inside shards: uncompressed ZIP files whose members are sealed episode files, unchanged.

ZIP because every system can list and unpack it, and because a stored (not compressed) member lies in it byte by byte:
reading an episode from a shard is reading it from a file at an offset.

A shard is refused as a whole if its list of contents is not plain: an episode that is compressed, encrypted, a link,
listed twice, or overlaps another one; a name that would lie outside the folder when it is unpacked.
"""

import functools
import io
import os
import re
import stat
import struct
import zipfile
from dataclasses import dataclass
from pathlib import Path

from svfl_data.errors import FormatError
from svfl_data.storage.chunks import Extent, pread
from svfl_data.system.printable import printable
from svfl_data.system.stored_zip import leads_out

PATTERN = "shard_*.zip"
MEMBER = re.compile(r"episode_(\d{6}|[1-9]\d{6,17})\.hdf5", re.ASCII)
"""The one name that the file of an episode has: its number in six digits, in more only where six do not suffice."""
LOCAL_HEADER = struct.Struct("<4s22xHH")  # signature; lengths of the name and of the extra field that follow
ENCRYPTED = 0x1  # bit of a member's flags
DIRECTORY_BYTES = 2**23
"""Most bytes that a shard's list of contents may have: 129,000 episodes."""


@dataclass(frozen=True)
class Member:
    """An episode in a shard.

    Attributes:
        filename: Its name there.
        start: Where its local header begins.
        size: Of the episode, [bytes].
        end: Where at the latest it ends: there the next member begins, or the list of contents.
    """

    filename: str
    start: int
    size: int
    end: int


def shard_files(folder: Path) -> list[Path]:
    """The shards of a dataset, in order."""
    return sorted(folder.glob(PATTERN))


def members(shard: Path) -> dict[int, Member]:
    """Episodes of a shard, by index.

    Raises:
        FormatError: If it is not a ZIP file, or not a plain one.
    """
    return _members(Extent.of_file(shard))


@functools.lru_cache(maxsize=1024)
def _members(shard: Extent) -> dict[int, Member]:
    try:
        with io.FileIO(shard.open()) as opened, zipfile.ZipFile(_Careful(opened)) as archive:
            listed, end = sorted(archive.infolist(), key=lambda info: info.header_offset), archive.start_dir
    except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError, struct.error) as error:
        raise FormatError(f"{shard}: not a readable shard ({printable(error)})") from error
    found: dict[int, Member] = {}
    for info, after in zip(listed, [*(info.header_offset for info in listed), end][1:], strict=True):
        name = f"{shard}: {printable(info.filename, 100)}"
        _check_name(info.filename, name)
        if match := MEMBER.fullmatch(info.filename):
            _check_stored(info, name)
            if int(match[1]) in found:
                raise FormatError(f"{name} is a second episode {int(match[1])}, beside {found[int(match[1])].filename}")
            found[int(match[1])] = Member(info.filename, info.header_offset, info.file_size, after)
    if not found:
        raise FormatError(f"{shard}: a shard without episodes")
    return found


class _Careful(io.BufferedReader):
    """A shard as `zipfile` reads it; its list of contents is read at once, whatever size it claims."""

    def read(self, size: int | None = -1, /) -> bytes:
        if size is not None and size > DIRECTORY_BYTES:
            raise ValueError(f"its list of contents has {size} bytes; possible are {DIRECTORY_BYTES}")
        return super().read(size)


def _check_name(filename: str, name: str) -> None:
    if leads_out(filename):
        raise FormatError(f"{name}: a name that leads out of the folder; the shard is refused")


def _check_stored(info: zipfile.ZipInfo, name: str) -> None:
    if info.compress_type != zipfile.ZIP_STORED:
        raise FormatError(f"{name} is compressed; a shard stores episodes as they are")
    if info.flag_bits & ENCRYPTED or stat.S_ISLNK(info.external_attr >> 16) or info.compress_size != info.file_size:
        raise FormatError(f"{name} is encrypted, a link, or of two sizes; a shard stores episodes as they are")


def member_extent(shard: Path, member: Member) -> Extent:
    """Where an episode lies in its shard.

    Raises:
        FormatError: If the shard does not hold it where it says.
    """
    whole = Extent.of_file(shard)
    descriptor = whole.open()
    try:
        header = pread(whole, descriptor, LOCAL_HEADER.size, member.start)
        signature, name, extra = LOCAL_HEADER.unpack(header)
        local = pread(whole, descriptor, name, member.start + LOCAL_HEADER.size)
    finally:
        os.close(descriptor)
    if signature != b"PK\x03\x04" or local != member.filename.encode():
        raise FormatError(f"{shard}: damaged (no {member.filename} at byte {member.start})")
    offset = member.start + LOCAL_HEADER.size + name + extra
    if offset + member.size > member.end:
        raise FormatError(f"{shard}: damaged ({member.filename} ends beyond its place)")
    return whole.part(member.filename, offset, member.size)
