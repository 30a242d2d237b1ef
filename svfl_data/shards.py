"""Finding episodes inside shards: uncompressed ZIP files whose members are sealed episode files, unchanged.

ZIP because every system can list and unpack it, and because a stored (not compressed) member lies in it byte by byte:
reading an episode from a shard is reading it from a file at an offset.
"""

import functools
import os
import re
import struct
import zipfile
from pathlib import Path

from svfl_data.chunks import Extent, pread
from svfl_data.errors import FormatError

PATTERN = "shard_*.zip"
MEMBER = re.compile(r"episode_(\d{6}|[1-9]\d{6,17})\.hdf5", re.ASCII)
"""The one name that the file of an episode has: its number in six digits, in more only where six do not suffice."""
LOCAL_HEADER = struct.Struct("<4s22xHH")  # signature; lengths of the name and of the extra field that follow


def shard_files(folder: Path) -> list[Path]:
    """The shards of a dataset, in order."""
    return sorted(folder.glob(PATTERN))


def members(shard: Path) -> dict[int, zipfile.ZipInfo]:
    """Episodes of a shard, by index.

    Raises:
        FormatError: If it is not a ZIP file, or holds a compressed episode.
    """
    whole = Extent.of_file(shard)
    return _members(shard, whole.file_size, whole.mtime_ns)


@functools.lru_cache(maxsize=1024)
def _members(shard: Path, size: int, mtime_ns: int) -> dict[int, zipfile.ZipInfo]:
    try:
        with zipfile.ZipFile(shard) as archive:
            listed = archive.infolist()
    except (zipfile.BadZipFile, OSError, ValueError) as error:
        raise FormatError(f"{shard}: not a readable shard ({error})") from error
    found = {}
    for info in listed:
        if match := MEMBER.fullmatch(info.filename):
            if info.compress_type != zipfile.ZIP_STORED:
                raise FormatError(f"{shard}: {info.filename} is compressed; a shard stores episodes as they are")
            found[int(match[1])] = info
    return found


def member_extent(shard: Path, info: zipfile.ZipInfo) -> Extent:
    """Where an episode lies in its shard.

    Raises:
        FormatError: If the shard does not hold it where it says.
    """
    whole = Extent.of_file(shard)
    descriptor = whole.open()
    try:
        header = pread(whole, descriptor, LOCAL_HEADER.size, info.header_offset)
    finally:
        os.close(descriptor)
    signature, name, extra = LOCAL_HEADER.unpack(header)
    if signature != b"PK\x03\x04":
        raise FormatError(f"{shard}: damaged (no {info.filename} at byte {info.header_offset})")
    offset = info.header_offset + LOCAL_HEADER.size + name + extra
    if offset + info.file_size > whole.file_size:
        raise FormatError(f"{shard}: damaged ({info.filename} ends beyond the file)")
    return Extent(shard, offset, info.file_size, whole.file_size, whole.mtime_ns, info.filename)
