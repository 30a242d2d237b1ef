"""JSON that strangers may have written, as declared models or one clear error.

What is read is bounded in size and depth, parsed once, and compared with a `msgspec.Struct` (or dataclass) that says
which keys there must be and of which types; what does not fit is one line that names the file and the key. What is
written goes through the same bounds, so that nothing is stored that could not be read again.
"""

import math
from pathlib import Path
from typing import Annotated, Any, TypeVar

import msgspec
import numpy as np

from svfl_data.errors import FieldError, FormatError, SvflError
from svfl_data.system.printable import printable
from svfl_data.system.regular_file import read_regular

SIZE_LIMIT = 2**24
"""Bytes of JSON that are read at once; the largest that commands write are splits, 8 bytes per episode."""
DEPTH_LIMIT = 32
"""Lists and objects inside each other."""
BITS_LIMIT = 128
"""Of an integer: room for the state of a random generator, and for conversion to a float."""

Int64 = Annotated[int, msgspec.Meta(ge=-(2**63), le=2**63 - 1)]
"""An integer that HDF5 and NumPy can hold."""
Count = Annotated[int, msgspec.Meta(ge=0, le=2**63 - 1)]

Model = TypeVar("Model")


def read_side_file(path: Path, limit: int = SIZE_LIMIT) -> Any:  # noqa: ANN401 - any JSON value
    """The value of a JSON file.

    Args:
        path: An ordinary file (`regular_file.read_regular`).
        limit: Most bytes that it may have.

    Raises:
        FormatError: If it is no ordinary file, too large, not JSON, or beyond the limits above.
        FileNotFoundError: If it does not exist.
    """
    try:
        content = read_regular(path, limit)
    except FileNotFoundError:
        raise
    except OSError as error:
        raise FormatError(f"{path}: cannot be read ({error.strerror})") from error
    return parse_json(content, path)


def read_json(path: Path) -> Any:  # noqa: ANN401 - any JSON value
    """The value of a JSON file that the user has named, or that a command of ours has left where the user said.

    Args:
        path: An ordinary file, or a link to one.

    Raises:
        FormatError: If it is no ordinary file, too large, not JSON, or beyond the limits above.
        OSError: If it does not exist or cannot be read.
    """
    return parse_json(read_regular(path.resolve(), SIZE_LIMIT), path)


def parse_json(content: bytes | str, where: object, limit: int = SIZE_LIMIT) -> Any:  # noqa: ANN401 - any JSON value
    """The value of a JSON text.

    Args:
        content: The text, in UTF-8 if in bytes.
        where: What to name in the error, such as the file.
        limit: Most bytes that it may have.

    Raises:
        FormatError: If it is too long, not JSON, or beyond the limits above.
    """
    if len(content) > limit:
        raise FormatError(f"{where}: larger than the {limit} bytes of JSON that are read")
    try:
        value = msgspec.json.decode(content)
    except RecursionError as error:
        raise FormatError(f"{where}: not readable as JSON (nested deeper than {DEPTH_LIMIT} levels)") from error
    except (ValueError, UnicodeError) as error:  # msgspec's errors among them
        raise FormatError(f"{where}: not readable as JSON ({printable(error)})") from error
    check_bounds(value, where, FormatError)
    return value


def check_format(value: Any, name: str, version: str, where: object, what: str) -> None:  # noqa: ANN401 - any JSON value
    """Refuse a JSON value that does not say that it is what was expected, in a version that can be read.

    Args:
        value: From `parse_json`.
        name: What its key ``format`` must be.
        version: Our version; the first number of its key ``format_version`` must be the same.
        where: What to name in the error, such as the file.
        what: What it does not, such as ``not a split``.

    Raises:
        FormatError: If it is something else, or of another version.
    """
    if not isinstance(value, dict) or value.get("format") != name:
        raise FormatError(f"{where}: {what} (format is not {name!r})")
    found, ours = value.get("format_version"), version.split(".")[0]
    if not isinstance(found, str) or found.split(".")[0] != ours:
        raise FormatError(f"{where}: format version {printable(found, 40)}; this software reads {ours}.x")


def parse_as(value: Any, model: type[Model], where: object) -> Model:  # noqa: ANN401 - any JSON value
    """A JSON value as a declared model; keys that the model does not have are ignored.

    Args:
        value: From `parse_json`, or made of the same types.
        model: What it must be.
        where: What to name in the error, such as the file.

    Raises:
        FormatError: If a key is missing or a value is of another type.
    """
    try:
        return msgspec.convert(value, model)
    except (msgspec.ValidationError, RecursionError) as error:
        raise FormatError(f"{where}: {printable(error)}") from error


def check_bounds(value: Any, where: object, kind: type[SvflError]) -> None:  # noqa: ANN401 - any JSON value
    """Refuse what nests too deeply, numbers that are too large or not finite, and text that is not Unicode.

    Args:
        value: Made of dict, list, str, int, float, bool and None.
        where: What to name in the error.
        kind: Of the error.

    Raises:
        SvflError: Of that kind.
    """
    level, depth = [("", value)], 0  # one level of nesting at a time: no recursion
    while level:
        if depth > DEPTH_LIMIT:
            raise kind(f"{where}: nested deeper than {DEPTH_LIMIT} levels")
        below: list[tuple[str, Any]] = []
        for key, item in level:
            if type(item) is dict:
                for name, inner in item.items():
                    _check_leaf(f"{key}.{name}", name, where, kind)
                    below.append((f"{key}.{name}" if depth < 4 else key, inner))
            elif type(item) is list:
                below += [(key, inner) for inner in item]
            else:
                _check_leaf(key, item, where, kind)
        level, depth = below, depth + 1


def _check_leaf(key: str, value: Any, where: object, kind: type[SvflError]) -> None:  # noqa: ANN401 - any JSON value
    named = printable(key.removeprefix("."), 80) or "it"
    if type(value) is str:
        if not value.isascii() and any("\ud800" <= character <= "\udfff" for character in value):
            raise kind(f"{where}: {named}: {printable(value, 80)!r} is not Unicode text (a lone surrogate)")
    elif type(value) is int:
        if value.bit_length() > BITS_LIMIT:
            raise kind(f"{where}: {named}: an integer of {value.bit_length()} bits; at most {BITS_LIMIT} are possible")
    elif type(value) is float:
        if not math.isfinite(value):
            raise kind(f"{where}: {named} is {value}; only finite numbers can be stored as JSON")
    elif value is not None and type(value) is not bool:
        raise kind(f"{where}: {named} is a {type(value).__name__}, which JSON has not")


def plain(value: Any, where: object) -> Any:  # noqa: ANN401 - any value
    """A value made of what JSON has: NumPy's scalars become Python's, arrays and tuples become lists.

    Args:
        value: Given by a program, such as the configuration of an episode.
        where: What to name in the error.

    Raises:
        FieldError: If it cannot be stored as JSON, or is beyond the limits above.
    """
    made = _plain(value, where, 0)
    check_bounds(made, where, FieldError)
    return made


def _plain(value: Any, where: object, depth: int) -> Any:  # noqa: ANN401 - any value
    if depth > DEPTH_LIMIT:
        raise FieldError(f"{where}: nested deeper than {DEPTH_LIMIT} levels")
    if isinstance(value, dict):
        for key in value:
            if not isinstance(key, str):
                raise FieldError(
                    f"{where}: key {printable(repr(key), 80)} is a {type(key).__name__}, JSON has only text"
                )
        return {str(key): _plain(item, where, depth + 1) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item, where, depth + 1) for item in value]
    if isinstance(value, np.ndarray):
        return _plain(value.tolist(), where, depth)
    if isinstance(value, np.generic):
        return value.item()
    for kind in (bool, int, float, str):  # a subclass, such as an enumeration's member, as what it stands for
        if isinstance(value, kind):
            return value if type(value) is kind else kind(value)
    return value
