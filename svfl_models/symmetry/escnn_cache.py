"""Storage of the tables that escnn computes: in the user's cache instead of escnn's own package, and without pickle.

escnn 1.0.11 keeps tables of its groups, which take tens of CPU seconds to compute, with joblib in a folder inside the
installed package. Where this folder is read-only, as in a system-wide installation, importing escnn fails. joblib
unpickles the files that it finds, so anybody who can write there can run any code. Here a table is a JSON text of
numbers, tuples, lists and arrays in `svfl_data.system.cache_folder`. All projects of the user share the tables.
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
"""Most bytes of a table's file."""
PLAIN = (bool, int, float, str, type(None))
DTYPES = ("float64", "float32", "int64", "int32", "bool", "complex128")

Function = Callable[..., Any]


@contextmanager
def kept_by_the_user() -> Iterator[None]:
    """Replace `joblib.Memory` by `Tables` within the context; escnn, imported there, keeps its tables in the cache."""
    memory = joblib.Memory
    joblib.Memory = Tables
    try:
        yield
    finally:
        joblib.Memory = memory


class Tables:
    """Replacement of `joblib.Memory`, as far as escnn uses it: a cache of functions' results, by their arguments.

    Each result is computed at most once per process, and once per user where the user has a cache folder. Every call
    returns a new copy of the result.
    """

    def __init__(self, *_: object, **__: object) -> None:
        self._known: dict[str, str] = {}

    def cache(self, function: Function | None = None, ignore: object = None) -> Function:
        """Return a function that looks for a stored result before it computes one.

        This method is used as a decorator, with or without arguments.

        Args:
            function: Function whose results are stored. None returns a decorator.
            ignore: Arguments that joblib would ignore. A function for which they are given is returned as it is.
        """
        if function is None:
            return functools.partial(self.cache, ignore=ignore)
        if ignore:  # such a function takes a group itself, not only its name; escnn has them for 3-D groups only
            return function

        @functools.wraps(function)
        def kept(*arguments: object, **keywords: object) -> Any:  # noqa: ANN401 - whatever the function returns
            question = f"{function.__module__}.{function.__qualname__} {arguments!r} {sorted(keywords.items())!r}"
            key = hashlib.sha256(question.encode()).hexdigest()[:32]
            with suppress(KeyError, ValueError):
                return self._read(key)
            result = function(*arguments, **keywords)
            with suppress(TypeError):  # a result that JSON cannot hold is computed again
                self._write(key, json.dumps(_encoded(result)))
            return result

        return kept

    def _read(self, key: str) -> Any:  # noqa: ANN401
        """Return a result that is stored under a key.

        Raises:
            KeyError: If no result is stored under the key.
            ValueError: If the stored result is damaged.
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
            with suppress(StorageError):  # if the disk is full, the table is computed again next time
                write_atomically(folder / f"{key}.json", text.encode())


@functools.cache
def tables_folder() -> Path | None:
    """Return the folder of the tables; None if the user has no writable cache, or escnn's version is unknown."""
    try:
        return cache_folder(f"escnn-{metadata.version('escnn')}")
    except metadata.PackageNotFoundError:
        return None


def _encoded(value: object) -> object:
    """Return a result as plain values that JSON can hold.

    Raises:
        TypeError: If the result holds anything but numbers, texts, None, tuples, lists and arrays of numbers.
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
    """Return the result from which `_encoded` made a value."""
    if not isinstance(value, list):
        return value
    kind, *rest = value
    if kind == "array":
        name, shape, data = rest
        if name not in DTYPES:
            raise ValueError(f"no arrays of {name}")
        return np.frombuffer(base64.b64decode(data, validate=True), name).reshape(shape).copy()
    return {"tuple": tuple, "list": list}[kind](map(_decoded, rest))
