"""Opening an episode: its seal is checked, its arrays are located, and whether it is valid is judged, once.

What was learned is kept in the process, and in the user's private cache (`svfl_data.storage.header_cache`) for the next
one. HDF5 sees the bytes of a file in another process only (`svfl_data.storage.examination`), save those that this
process has just written itself.
"""

import hashlib
import os
import threading
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from svfl_data.errors import FieldError, FormatError, SvflError
from svfl_data.schema.fields import field_at
from svfl_data.schema.validity import check_arrays
from svfl_data.storage import header_cache
from svfl_data.storage.admission import Description
from svfl_data.storage.chunks import Extent, Placement
from svfl_data.storage.examination import Unanswered, ask
from svfl_data.storage.metadata import JSON_ATTRIBUTES, PLAIN_ATTRIBUTES, parse_meta
from svfl_data.storage.seal import HDF5_MAGIC, SEAL_MARK, SEAL_SIZE, broken
from svfl_data.storage.stored_array import StoredArray
from svfl_data.system.printable import printable

FORMAT = "svfl-episode"
FORMAT_VERSION = "1.0"
"""Major.minor: readers accept every minor of their own major, since a minor version only adds optional fields."""
MEANING = ("unit", "axes", "about")
"""Attributes of a dataset without which its numbers mean nothing; they must be as declared."""
NAMES = {"names": ["format", "format_version", *PLAIN_ATTRIBUTES, *JSON_ATTRIBUTES], "meaning": list(MEANING)}
HEADERS_KEPT, BYTES_KEPT = 512, 2**27
"""How many episodes a process remembers, and how large their descriptions may be in all."""


@dataclass(frozen=True, eq=False)
class Header:
    """What is known of a valid episode once it was opened.

    Attributes:
        seal: SHA-256 of its content, in hexadecimal.
        attributes: Of the file, by name.
        placements: Where each array lies, by dataset path.
        hashed: Whether its bytes were compared with its seal in this process, rather than by an earlier one that saw
            the same file, unchanged since.
        nbytes: Memory that it takes, about.
    """

    seal: str
    attributes: Mapping[str, Any]
    placements: dict[str, Placement]
    hashed: bool
    nbytes: int


def header(extent: Extent, hashed: bool = False) -> Header:
    """What is known of an episode; the first time, it is found out.

    Args:
        extent: The episode.
        hashed: Whether its bytes must have been compared with its seal in this process.

    Raises:
        FormatError: If the episode is damaged, foreign, of another version, refused, or has changed since it was found.
        FieldError: If a field is missing or of another type or shape than declared.
    """
    with _lock:
        known = _known.get(extent)
    if known is None:
        known = _remembered(extent) or _opened(extent)
        _keep(extent, known)
    if not isinstance(known, Header):
        raise type(known)(*known.args)  # a new one: each has the way that led to it
    if hashed and not known.hashed:
        if checked_seal(extent) != known.seal:
            raise FormatError(f"{extent}: not what it was when it was last read, though nothing says that it changed")
        known = replace(known, hashed=True)
        _keep(extent, known)
    return known


def know_own(extent: Extent) -> None:
    """Get to know an episode that this very process has just written, without a process that examines it.

    Raises:
        SvflError: As `header`.
    """
    from svfl_data.storage.examiner import Content, examine  # HDF5 is in this process already: it has written the file

    digest = checked_seal(extent)
    descriptor = extent.open()
    try:
        answer = b"".join(examine(Content(descriptor, extent.offset, extent.size - SEAL_SIZE), **NAMES))
    finally:
        os.close(descriptor)
    _keep(extent, _judged(extent, extent.size - SEAL_SIZE, digest, answer))


def unsealed_header(extent: Extent) -> Header:
    """What is known of an episode file that lost its seal to other software; `Header.seal` is empty.

    Raises:
        SvflError: As `header`.
    """
    return _judged(extent, extent.size, "", _examined(extent, extent.size))


def forget() -> None:
    """Open every episode anew from now on; only the user's cache still knows them."""
    with _lock:
        _known.clear()


def checked_seal(extent: Extent) -> str:
    """SHA-256 of an episode's content, in hexadecimal, read and compared with its seal.

    Raises:
        FormatError: If the episode is damaged or was never sealed.
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
    """Refuse files that are not episodes, or of another major version.

    Args:
        attributes: Those of the file.
        where: What to name in the error, such as the file.

    Raises:
        FormatError: If the file is another one.
    """
    found = attributes.get("format")
    if found != FORMAT:
        raise FormatError(
            f"{where}: an HDF5 file, but not an episode (attribute format is {_short(found)}, not {FORMAT!r})"
        )
    version, ours = attributes.get("format_version"), FORMAT_VERSION.split(".")[0]
    if not isinstance(version, str) or version.split(".")[0] != ours:
        found = printable(version if isinstance(version, str) else repr(version), 40)
        raise FormatError(f"{where}: format version {found}; this software reads {ours}.x")


def check_meaning(path: str, attributes: Mapping[str, Any], where: object) -> None:
    """Refuse numbers of another unit, in other axes or about another point than declared.

    Args:
        path: Dataset path.
        attributes: Those of the dataset in the file.
        where: What to name in the error, such as the file.

    Raises:
        FieldError: If one differs from the field's declaration.
    """
    field = field_at(path)
    for name in MEANING if field else ():
        found, expected = attributes.get(name), getattr(field, name)
        if found != expected:
            raise FieldError(f"{where}: field {path} has {name} {_short(found)}, expected {expected!r}")


def _short(value: object) -> str:
    return printable(repr(value), 100)


def _remembered(extent: Extent) -> Header | None:
    """What an earlier process learned of the same file, unchanged since."""
    found = header_cache.recall(extent)
    if found is None:
        return None
    digest, answer = found
    try:
        description = Description(answer, extent)
        return Header(
            digest, description.attributes, description.placements(extent.size - SEAL_SIZE), False, len(answer)
        )
    except (SvflError, ValueError):
        return None  # other limits now: open it again, which says what is wrong


def _opened(extent: Extent) -> Header | FormatError | FieldError:
    """An episode that nobody knows, or why it is refused."""
    try:
        digest = checked_seal(extent)
        answer = _examined(extent, extent.size - SEAL_SIZE)
        found = _judged(extent, extent.size - SEAL_SIZE, digest, answer)
    except (FormatError, FieldError) as error:
        return error
    header_cache.remember(extent, digest, answer)
    return found


def _examined(extent: Extent, size: int) -> bytes:
    descriptor = extent.open()
    try:
        return ask(descriptor, {"offset": extent.offset, "size": size, **NAMES})
    except Unanswered as error:
        raise FormatError(f"{extent}: not a readable episode ({error})") from error
    finally:
        os.close(descriptor)


def _judged(extent: Extent, size: int, digest: str, answer: bytes) -> Header:
    """The one verdict on an episode: whatever this lets pass, every tool can work with.

    Raises:
        SvflError: If it is not valid.
    """
    description = Description(answer, extent)
    if not (description.problem and not description.attributes):
        check_format(description.attributes, extent)
    if description.problem:
        raise FormatError(f"{extent}: {description.problem}")
    placements = description.placements(size)
    for path, attributes in description.arrays.items():
        check_meaning(path, attributes, extent)
    parse_meta(description.attributes, extent)
    check_arrays({path: StoredArray(path, extent, found) for path, found in placements.items()}, str(extent))
    return Header(digest, description.attributes, placements, True, len(answer))


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
