"""Where escnn keeps what it has computed: in the user's cache instead of its own package, and without pickle.

escnn 1.0.11 keeps tables of its groups (tens of CPU seconds to compute) with joblib, in a folder inside the installed
package; where that is read-only, as for a system-wide installation, importing escnn fails. joblib unpickles what it
finds, so whoever can write there can run anything. Here a table is a JSON text of numbers, tuples, lists and arrays in
`svfl_data.system.cache_folder`. The tables hold for every project of the user.
"""

import base64
import functools
import hashlib
import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from importlib import metadata
from pathlib import Path
from typing import Any

import joblib
import numpy as np

from svfl_data.errors import FormatError, StorageError
from svfl_data.system.atomic_io import write_atomically
from svfl_data.system.cache_folder import cache_folder
from svfl_data.system.regular_file import read_regular

LARGEST = 64 * 2**20
"""Most bytes of a table."""
PLAIN = (bool, int, float, str, type(None))
DTYPES = ("float64", "float32", "int64", "int32", "bool", "complex128")

Function = Callable[..., Any]


@contextmanager
def kept_by_the_user() -> Iterator[None]:
    """Import escnn in here: it then keeps its tables as `Tables` does."""
    memory = joblib.Memory
    joblib.Memory = Tables
    try:
        yield
    finally:
        joblib.Memory = memory


class Tables:
    """In the place of `joblib.Memory`, as far as escnn uses it: results of functions, by their arguments.

    Each is computed once in a process, and once by a user who has a cache. Every call gets a copy of its own.
    """

    def __init__(self, *_: object, **__: object) -> None:
        self._known: dict[str, str] = {}

    def cache(self, function: Function | None = None, ignore: object = None) -> Function:
        """The function, which looks for its result before it computes; as a decorator, with or without arguments."""
        if function is None:
            return functools.partial(self.cache, ignore=ignore)
        if ignore:  # takes a group itself, not only its name; these are of 3-D groups
            return function

        @functools.wraps(function)
        def kept(*arguments: object, **keywords: object) -> Any:  # noqa: ANN401 - whatever the function gives
            question = f"{function.__module__}.{function.__qualname__} {arguments!r} {sorted(keywords.items())!r}"
            key = hashlib.sha256(question.encode()).hexdigest()[:32]
            with suppress(KeyError, ValueError):
                return self._read(key)
            result = function(*arguments, **keywords)
            with suppress(TypeError):  # what cannot be written down is computed again
                self._write(key, json.dumps(_encoded(result)))
            return result

        return kept

    def _read(self, key: str) -> Any:  # noqa: ANN401
        """A result that is known.

        Raises:
            KeyError: If it is not.
            ValueError: If what is kept of it is damaged.
        """
        if key not in self._known:
            folder = tables_folder()
            if folder is None:
                raise KeyError(key)
            try:
                self._known[key] = read_regular(folder / f"{key}.json", LARGEST).decode()
            except (OSError, FormatError) as error:
                raise KeyError(key) from error
        try:
            return _decoded(json.loads(self._known[key]))
        except (ValueError, TypeError, LookupError, RecursionError) as error:
            del self._known[key]
            raise ValueError(key) from error

    def _write(self, key: str, text: str) -> None:
        self._known[key] = text
        if folder := tables_folder():
            with suppress(StorageError):  # a full disk costs the time to compute it again
                write_atomically(folder / f"{key}.json", text.encode())


@functools.cache
def tables_folder() -> Path | None:
    """Where tables are kept; none without a home that can be written, or a version."""
    try:
        return cache_folder(f"escnn-{metadata.version('escnn')}")
    except metadata.PackageNotFoundError:
        return None


def _encoded(value: object) -> object:
    """A result in terms of JSON.

    Raises:
        TypeError: If it holds anything but numbers, texts, tuples, lists and arrays of numbers.
    """
    if type(value) in PLAIN:
        return value
    if type(value) in (tuple, list):
        return [type(value).__name__, *map(_encoded, value)]  # type: ignore[call-overload] # its type is known
    if type(value) is np.ndarray and value.dtype.name in DTYPES:
        data = base64.b64encode(np.ascontiguousarray(value).tobytes()).decode()
        return ["array", value.dtype.name, list(value.shape), data]
    if isinstance(value, np.integer):
        return int(value)
    raise TypeError(type(value).__name__)


def _decoded(value: Any) -> Any:  # noqa: ANN401
    """What `_encoded` was given."""
    if not isinstance(value, list):
        return value
    kind, *rest = value
    if kind == "array":
        name, shape, data = rest
        if name not in DTYPES:
            raise ValueError(f"no arrays of {name}")
        return np.frombuffer(base64.b64decode(data, validate=True), name).reshape(shape).copy()
    return {"tuple": tuple, "list": list}[kind](map(_decoded, rest))
