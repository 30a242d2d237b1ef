"""Conversion of untrusted JSON into declared models, with limits on the JSON and one-line errors.

JSON that is read is limited in size and depth, parsed once, and compared with a `msgspec.Struct` (or dataclass) that
declares which keys there must be and of which types. JSON that does not fit causes a one-line error that names the file
and the key. JSON that is written must be within the same limits, so that nothing is stored that could not be read
again.
"""

import math
import re
from pathlib import Path
from typing import Annotated, Any, TypeVar

import msgspec
import numpy as np

from svfl_data.errors import FieldError, FormatError, SvflError
from svfl_data.system.printable import printable
from svfl_data.system.regular_file import read_regular

SIZE_LIMIT = 2**24
"""Largest size of a JSON text that is read, [bytes]. The largest texts that commands write are splits, with 8 bytes per
episode."""
DEPTH_LIMIT = 32
"""Largest number of levels of lists and objects inside each other."""
BITS_LIMIT = 128
"""Largest number of bits of an integer, which is enough for the state of a random generator and allows conversion to a
float."""

Int64 = Annotated[int, msgspec.Meta(ge=-(2**63), le=2**63 - 1)]
"""An integer that HDF5 and NumPy can hold."""
Count = Annotated[int, msgspec.Meta(ge=0, le=2**63 - 1)]

Model = TypeVar("Model")


def read_side_file(path: Path, limit: int = SIZE_LIMIT) -> Any:  # noqa: ANN401 - any JSON value
    """Return the value of a JSON file that must be an ordinary file, such as a file inside a dataset.

    Args:
        path: Path of the file, which must be an ordinary file (`regular_file.read_regular`).
        limit: Largest allowed size of the file, [bytes].

    Raises:
        FormatError: If the file is not an ordinary file, is too large, cannot be read, is not JSON, or is beyond
            `DEPTH_LIMIT` or `BITS_LIMIT`.
        FileNotFoundError: If the file does not exist.
    """
    try:
        content = read_regular(path, limit)
    except FileNotFoundError:
        raise
    except OSError as error:
        raise FormatError(f"{path}: cannot be read ({error.strerror})") from error
    return parse_json(content, path)


def read_json(path: Path) -> Any:  # noqa: ANN401 - any JSON value
    """Return the value of a JSON file that the user has named, or that a command has written where the user said.

    Args:
        path: Path of an ordinary file, or of a link to one.

    Raises:
        FormatError: If the file is not an ordinary file, is larger than `SIZE_LIMIT`, is not JSON, or is beyond
            `DEPTH_LIMIT` or `BITS_LIMIT`.
        OSError: If the file does not exist or cannot be read.
    """
    return parse_json(read_regular(path.resolve(), SIZE_LIMIT), path)


def parse_json(content: bytes | str, where: object, limit: int = SIZE_LIMIT) -> Any:  # noqa: ANN401 - any JSON value
    """Return the value of a JSON text.

    Args:
        content: JSON text. Bytes are read as UTF-8.
        where: Source of the text that the error names, such as the file.
        limit: Largest allowed length of `content`: in bytes if it is bytes, in characters if it is a string.

    Raises:
        FormatError: If the text is too long, is not JSON, or is beyond `DEPTH_LIMIT` or `BITS_LIMIT`.
    """
    if len(content) > limit:
        raise FormatError(f"{where}: larger than the {limit} bytes of JSON that are read")
    try:
        value = msgspec.json.decode(content)
    except RecursionError as error:
        raise FormatError(f"{where}: not readable as JSON (nested deeper than {DEPTH_LIMIT} levels)") from error
    except (ValueError, UnicodeError) as error:  # including msgspec's errors
        raise FormatError(f"{where}: not readable as JSON ({printable(error)})") from error
    check_bounds(value, where, FormatError)
    return value


def check_format(value: Any, name: str, version: str, where: object, what: str) -> None:  # noqa: ANN401 - any JSON value
    """Raise an error if a JSON value does not declare the expected format in a version that can be read.

    Args:
        value: JSON value from `parse_json`.
        name: Required value of the key ``format``.
        version: Format version of this software, such as ``1.0``. The first number of the key ``format_version`` must
            be the same.
        where: Source of the value that the error names, such as the file.
        what: Start of the error message for another format, such as ``not a split``.

    Raises:
        FormatError: If the value declares another format or another version, or none.
    """
    if not isinstance(value, dict) or value.get("format") != name:
        raise FormatError(f"{where}: {what} (format is not {name!r})")
    found = value.get("format_version")
    if not reads(version, found):
        ours = version.partition(".")[0]
        raise FormatError(f"{where}: format version {printable(found, 40)}; this software reads {ours}.x")


def reads(version: str, found: object) -> bool:
    """Return whether software that writes a format version, such as ``2.0``, reads files of another one.

    Args:
        version: Format version of this software.
        found: What a file says its version is; anything but two numbers with a point between them is not read.
    """
    return isinstance(found, str) and bool(re.fullmatch(rf"{version.partition('.')[0]}\.[0-9]{{1,9}}", found))


def parse_as(value: Any, model: type[Model], where: object) -> Model:  # noqa: ANN401 - any JSON value
    """Return a JSON value converted to a declared model; keys that the model does not have are ignored.

    Args:
        value: JSON value from `parse_json`, or a value made of the same types.
        model: Class of the result, such as a `msgspec.Struct` or a dataclass.
        where: Source of the value that the error names, such as the file.

    Raises:
        FormatError: If a key is missing or a value is of another type.
    """
    try:
        return msgspec.convert(value, model)
    except (msgspec.ValidationError, RecursionError) as error:
        raise FormatError(f"{where}: {printable(error)}") from error


def check_bounds(value: Any, where: object, kind: type[SvflError]) -> None:  # noqa: ANN401 - any JSON value
    """Raise an error if a value could not be stored as JSON and read again.

    The function refuses values that nest deeper than `DEPTH_LIMIT`, integers of more than `BITS_LIMIT` bits, numbers
    that are not finite, text that is not Unicode, and types that JSON does not have.

    Args:
        value: Value made of dict, list, str, int, float, bool and None.
        where: Source of the value that the error names.
        kind: Class of the error that is raised.

    Raises:
        SvflError: If the value is refused. The error is of the class `kind`.
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
    if fault := _leaf_fault(value):
        raise kind(f"{where}: {printable(key.removeprefix('.'), 80) or 'it'}{fault}")


def _leaf_fault(value: Any) -> str | None:  # noqa: ANN401 - any JSON value
    """Return what is wrong with a single value, in words that follow its name; None if nothing is."""
    if type(value) is str:
        if not value.isascii() and any("\ud800" <= character <= "\udfff" for character in value):
            return f": {printable(value, 80)!r} is not Unicode text (a lone surrogate)"
    elif type(value) is int:
        if value.bit_length() > BITS_LIMIT:
            return f": an integer of {value.bit_length()} bits; at most {BITS_LIMIT} are possible"
    elif type(value) is float:
        if not math.isfinite(value):
            return f" is {value}; only finite numbers can be stored as JSON"
    elif value is not None and type(value) is not bool:
        return f" has type {type(value).__name__}, which JSON cannot represent"
    return None


def plain(value: Any, where: object) -> Any:  # noqa: ANN401 - any value
    """Return a value made of JSON types: NumPy scalars become Python numbers, arrays and tuples become lists.

    Args:
        value: Value that a program has given, such as the configuration of an episode.
        where: Name of the value in the error.

    Raises:
        FieldError: If the value cannot be stored as JSON, or is beyond `DEPTH_LIMIT` or `BITS_LIMIT`.
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
                found = f"{printable(repr(key), 80)} of type {type(key).__name__}"
                raise FieldError(f"{where}: has the key {found}; keys in JSON are text")
        return {str(key): _plain(item, f"{where}.{printable(key, 80)}", depth + 1) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item, where, depth + 1) for item in value]
    if isinstance(value, np.ndarray):
        return _plain(value.tolist(), where, depth)
    if isinstance(value, np.generic):
        return value.item()
    for kind in (bool, int, float, str):  # a member of a subclass, such as an enumeration, becomes a plain value
        if isinstance(value, kind):
            return value if type(value) is kind else kind(value)
    return value
