"""Opening of an episode: its seal is checked, its arrays are located, and its validity is checked, once.

The result is kept in this process, and in the user's private cache (`svfl_data.storage.header_cache`) for later
processes. HDF5 reads a file only in another process (`svfl_data.storage.examination`), except files that this process
has just written itself.
"""

import hashlib
import os
import threading
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from svfl_data.errors import FieldError, FormatError, OldVersionError, SvflError
from svfl_data.schema.declarations import Declarations
from svfl_data.schema.field import MEANING
from svfl_data.schema.validity import check_arrays
from svfl_data.storage import header_cache
from svfl_data.storage.admission import Description
from svfl_data.storage.chunks import Extent, Placement
from svfl_data.storage.examination import Unanswered, ask
from svfl_data.storage.metadata import JSON_ATTRIBUTES, PLAIN_ATTRIBUTES, parse_meta
from svfl_data.storage.seal import HDF5_MAGIC, SEAL_MARK, SEAL_SIZE, broken
from svfl_data.storage.stored_array import StoredArray
from svfl_data.system.printable import printable
from svfl_data.system.side_files import reads

FORMAT = "svfl-episode"
FORMAT_VERSION = "2.0"
"""Version of the file format, major.minor. A reader accepts every minor version of its own major version, since a minor
version only adds standard fields, and a file declares all its arrays."""
NAMES = {"names": ["format", "format_version", *PLAIN_ATTRIBUTES, *JSON_ATTRIBUTES], "meaning": list(MEANING)}
HEADERS_KEPT, BYTES_KEPT = 512, 2**27
"""Largest number of episodes that a process remembers, and largest size of all their descriptions, [bytes]."""


@dataclass(frozen=True, eq=False)
class Header:
    """What is known of a valid episode after it was opened.

    Attributes:
        seal: SHA-256 of the episode's content, in hexadecimal; empty for an episode without a seal.
        attributes: Attributes of the episode file, by name.
        placements: Type, shape and place of each array, by dataset path.
        declarations: Declarations of the arrays.
        hashed: Whether this process compared the bytes of the episode with its seal. If False, an earlier process did
            so, and the file has not changed since.
        nbytes: Memory that the header takes, approximately, [bytes].
    """

    seal: str
    attributes: Mapping[str, Any]
    placements: dict[str, Placement]
    declarations: Declarations
    hashed: bool
    nbytes: int


def header(extent: Extent, hashed: bool = False) -> Header:
    """Return the header of an episode; the episode is opened and checked if this process has not opened it before.

    Args:
        extent: Place of the episode.
        hashed: Whether the bytes of the episode must have been compared with its seal in this process.

    Raises:
        FormatError: If the file is damaged, is not an episode, is of another version or is refused, or has changed
            since it was found.
        FieldError: If a field is missing or does not fit its declaration.
        StorageError: If the examiner cannot be started.
    """
    with _lock:
        known = _known.get(extent)
    if known is None:
        known = _remembered(extent) or _opened(extent)
        _keep(extent, known)
    if not isinstance(known, Header):
        raise type(known)(*known.args)  # a new exception, since each has its own traceback
    if hashed and not known.hashed:
        if checked_seal(extent) != known.seal:
            raise FormatError(
                f"{extent}: its content differs from the last reading, although its size and times are the same"
            )
        known = replace(known, hashed=True)
        _keep(extent, known)
    return known


def know_own(extent: Extent) -> None:
    """Open and check an episode that this process has just written itself, without an examining process.

    Args:
        extent: Place of the episode.

    Raises:
        FormatError: If the episode is damaged, or has changed since it was found.
        FieldError: If a field is missing or does not fit its declaration.
    """
    from svfl_data.storage.examiner import Content, examine  # HDF5 is in this process already: it has written the file

    digest = checked_seal(extent)
    descriptor = extent.open()
    try:
        answer = b"".join(examine(Content(descriptor, extent.offset, extent.size - SEAL_SIZE), **NAMES))
    finally:
        os.close(descriptor)
    _keep(extent, _checked(extent, extent.size - SEAL_SIZE, digest, answer))


def unsealed_header(extent: Extent) -> Header:
    """Return the header of an episode file that lost its seal to other software; its `Header.seal` is empty.

    Args:
        extent: Place of the episode: the whole file.

    Raises:
        FormatError: If the file is not a readable episode, or has changed since it was found.
        FieldError: If a field is missing or does not fit its declaration.
        StorageError: If the examiner cannot be started.
    """
    return _checked(extent, extent.size, "", examined(extent, extent.size))


def forget() -> None:
    """Forget every episode that this process has opened, so that each is opened again; the user's cache is kept."""
    with _lock:
        _known.clear()


def checked_seal(extent: Extent) -> str:
    """Read an episode, compare its content with its seal, and return the SHA-256 of the content in hexadecimal.

    Raises:
        FormatError: If the episode is damaged or was never sealed, or its file cannot be read or has changed.
    """
    digest, head, tail = hashlib.sha256(), b"", b""
    for block in extent.blocks():
        head, tail = head or block[: len(HDF5_MAGIC)], tail + block
        digest.update(tail[:-SEAL_SIZE])
        tail = tail[-SEAL_SIZE:]
    if tail != SEAL_MARK + digest.hexdigest().encode() + b"\n" or head != HDF5_MAGIC:
        raise broken(extent, head, tail, extent.size)
    return digest.hexdigest()


def check_format(attributes: Mapping[str, Any], where: object) -> None:
    """Refuse files that are not episodes, and episodes of another major version of the format.

    Args:
        attributes: Attributes of the file, by name.
        where: Source of the attributes, such as the file, as the error message names it.

    Raises:
        OldVersionError: If the file is an episode of version 1.
        FormatError: If the file is not an episode, or is an episode of another major version.
    """
    found = attributes.get("format")
    if found != FORMAT:
        raise FormatError(
            f"{where}: an HDF5 file, but not an episode (attribute format is {_short(found)}, not {FORMAT!r})"
        )
    version, ours = attributes.get("format_version"), FORMAT_VERSION.partition(".")[0]
    if not reads(FORMAT_VERSION, version):
        found = printable(version if isinstance(version, str) else repr(version), 40)
        words = f"{where}: format version {found}; this software reads {ours}.x"
        if reads("1.0", version):
            raise OldVersionError(f"{words}; svfl-data upgrade makes a new dataset of it")
        raise FormatError(words)


def _short(value: object) -> str:
    return printable(repr(value), 100)


def _remembered(extent: Extent) -> Header | None:
    """Return the header that an earlier process found for the same unchanged file; None if there is none."""
    found = header_cache.recall(extent)
    if found is None:
        return None
    digest, answer = found
    try:
        description = Description(answer, extent)
        declarations = description.declarations()
        placements = description.placements(extent.size - SEAL_SIZE, declarations)
        return Header(digest, description.attributes, placements, declarations, False, len(answer))
    except (SvflError, ValueError):
        return None  # the limits have changed: opening it again gives the right error


def _opened(extent: Extent) -> Header | FormatError | FieldError:
    """Open an episode that is neither in this process nor in the cache; return its header or the error."""
    try:
        digest = checked_seal(extent)
        answer = examined(extent, extent.size - SEAL_SIZE)
        found = _checked(extent, extent.size - SEAL_SIZE, digest, answer)
    except (FormatError, FieldError) as error:
        return error
    header_cache.remember(extent, digest, answer)
    return found


def examined(extent: Extent, size: int, names: Mapping[str, list[str]] = NAMES) -> bytes:
    """Return the examiner's answer about an episode, whose seal must have been checked if it has one.

    Args:
        extent: Place of the episode.
        size: Size of its content, without the seal, [bytes].
        names: Names of the attributes to read, as `svfl_data.storage.examiner.examine` takes them.

    Raises:
        FormatError: If the examiner cannot read the file, or the file has changed since it was found.
        StorageError: If the examiner cannot be started.
    """
    descriptor = extent.open()
    try:
        return ask(descriptor, {"offset": extent.offset, "size": size, **names})
    except Unanswered as error:
        raise FormatError(f"{extent}: not a readable episode ({error})") from error
    finally:
        os.close(descriptor)


def _checked(extent: Extent, size: int, digest: str, answer: bytes) -> Header:
    """Check an episode by the examiner's answer and return its header; every tool can use an episode that passes.

    Raises:
        SvflError: If the episode is not valid.
    """
    description = Description(answer, extent)
    if not (description.problem and not description.attributes):
        check_format(description.attributes, extent)
    if description.problem:
        raise FormatError(f"{extent}: {description.problem}")
    try:
        declarations = description.declarations()
    except FieldError as error:
        raise FieldError(f"{extent}: {error}") from error
    placements = description.placements(size, declarations)
    parse_meta(description.attributes, extent)
    found = Header(digest, description.attributes, placements, declarations, True, len(answer))
    check_arrays(stored_arrays(extent, found), str(extent), declarations)
    return found


def stored_arrays(extent: Extent, found: Header) -> dict[str, StoredArray]:
    """Return the arrays of an episode, whose rows are read on request, by dataset path.

    Args:
        extent: Place of the episode.
        found: Header of the episode.
    """
    return {path: StoredArray(path, extent, one, found.declarations.at(path)) for path, one in found.placements.items()}


def _keep(extent: Extent, found: Header | FormatError | FieldError) -> None:
    with _lock:
        _known[extent] = found
        _known.move_to_end(extent)
        size = sum(one.nbytes for one in _known.values() if isinstance(one, Header))
        while len(_known) > HEADERS_KEPT or (size > BYTES_KEPT and len(_known) > 1):
            dropped = _known.popitem(last=False)[1]
            size -= dropped.nbytes if isinstance(dropped, Header) else 0


_lock = threading.Lock()
_known: OrderedDict[Extent, Header | FormatError | FieldError] = OrderedDict()


def _after_fork() -> None:
    global _lock
    _lock = threading.Lock()  # another thread of the parent may have held it


os.register_at_fork(after_in_child=_after_fork)
