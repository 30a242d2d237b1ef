"""Episodes inside shards, which are uncompressed ZIP files whose members are unchanged, sealed episode files.

The format is ZIP because every system can list and unpack it, and because a stored (not compressed) member lies in it
byte by byte: reading an episode from a shard is reading it from a file at an offset.

A shard is refused as a whole if its list of contents is not plain: if an episode in it is compressed, encrypted, a
link, or listed twice, or if a name would lie outside the folder when the shard is unpacked. An episode that overlaps
the next member is refused when it is read.
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
"""Pattern of the only name that the file of an episode may have: its index in six digits, or in more digits only where
six do not suffice."""
LOCAL_HEADER = struct.Struct("<4s22xHH")  # signature; lengths of the name and of the extra field that follow
ENCRYPTED = 0x1  # bit of a member's flags
DIRECTORY_BYTES = 2**23
"""Largest size of a shard's list of contents, [bytes], which is enough for 129,000 episodes."""


@dataclass(frozen=True)
class Member:
    """Place of an episode in a shard.

    Attributes:
        filename: Name of the episode's file in the shard.
        start: Offset of the episode's local header in the shard, [bytes].
        size: Size of the episode, [bytes].
        end: Largest possible offset of the end of the episode, [bytes], where the next member or the list of contents
            begins.
    """

    filename: str
    start: int
    size: int
    end: int


def shard_files(folder: Path) -> list[Path]:
    """Return the shards of a dataset, sorted by name.

    Args:
        folder: Folder of the dataset.
    """
    return sorted(folder.glob(PATTERN))


def members(shard: Path) -> dict[int, Member]:
    """Return the episodes of a shard by index.

    Args:
        shard: File of the shard.

    Raises:
        FormatError: If the shard is not a ZIP file, or its list of contents is not plain.
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
    """Reader that gives a shard to `zipfile`, and refuses a list of contents of more than `DIRECTORY_BYTES`.

    Without this limit, `zipfile` would read as many bytes at once as the shard claims for its list of contents.
    """

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
        raise FormatError(f"{name} is encrypted, a link, or has two sizes; a shard stores episodes as they are")


def member_extent(shard: Path, member: Member) -> Extent:
    """Return the file and the byte range of an episode in a shard.

    Args:
        shard: File of the shard.
        member: Place of the episode, from `members`.

    Raises:
        FormatError: If the shard does not hold the episode at this place.
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
        raise FormatError(f"{shard}: damaged ({member.filename} is longer than its space in the file)")
    return whole.part(member.filename, offset, member.size)
