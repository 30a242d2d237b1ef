"""The description of a dataset, ``dataset.json``, and how a folder becomes a dataset."""

import json
import os
import re
from pathlib import Path
from typing import Any

import msgspec

from svfl_data.errors import DatasetError, FormatError, StorageError
from svfl_data.system.atomic_io import write_atomically
from svfl_data.system.printable import printable
from svfl_data.system.side_files import Int64, check_format, parse_as, read_side_file

FORMAT = "svfl-dataset"
FORMAT_VERSION = "1.0"
INFO = "dataset.json"
BEGINNING = re.compile(rf"\.{re.escape(INFO)}\..*\.part")
"""Pattern of the temporary names under which `write_atomically` writes ``dataset.json``."""


class Info(msgspec.Struct):
    """Keys that ``dataset.json`` must have, and the optional ``varies``. Other keys are allowed, too."""

    format: str
    format_version: str
    task: str
    seed: Int64
    config: dict[str, Any]
    varies: list[str] = []


def read_info(path: Path) -> dict[str, Any]:
    """Read and check ``dataset.json``.

    Args:
        path: Folder of the dataset.

    Raises:
        FormatError: If the file is missing, unreadable or of another version.
    """
    file = path / INFO
    try:
        info: dict[str, Any] = read_side_file(file)
    except FileNotFoundError as error:
        raise FormatError(f"{path}: not a dataset (it has no {INFO})") from error
    check_format(info, FORMAT, FORMAT_VERSION, file, "does not describe a dataset")
    parse_as(info, Info, file)
    return info


def begin(path: Path, info: dict[str, Any]) -> None:
    """Write ``dataset.json`` into an absent or empty folder, unless another process does so at the same moment.

    A process puts other files into the folder of a dataset only after it has seen ``dataset.json`` there, and that file
    is never removed. So this function lists the folder first, and looks for ``dataset.json`` afterwards: if
    ``dataset.json`` exists, another process has brought the other files; if not, they are foreign. Temporary files of
    ``dataset.json`` do not count, because other processes, also killed ones, may have left them.

    Args:
        path: Folder that becomes a dataset.
        info: Content of ``dataset.json``.

    Raises:
        DatasetError: If the folder holds other files, or is a file.
        StorageError: If the folder cannot be created or written.
    """
    empty = not path.exists() or (path.is_dir() and all(BEGINNING.fullmatch(name) for name in os.listdir(path)))
    if not empty and not (path / INFO).exists():
        found = f"holds other files and no {INFO}" if path.is_dir() else "is not a folder"
        raise DatasetError(f"{path} {found}; name a new or empty folder")
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StorageError(f"cannot create {path}: {error.strerror}") from error
    try:
        write_atomically(path / INFO, (json.dumps(info, indent=2, sort_keys=True) + "\n").encode(), replace=False)
    except StorageError:
        if not (path / INFO).exists():
            raise  # otherwise another process was first, and may have removed the temporary file


def check_same(path: Path, found: dict[str, Any], asked: dict[str, Any]) -> None:
    """Check that a dataset is the one that was asked for.

    Args:
        path: Folder of the dataset, for the error message.
        found: Description of the dataset.
        asked: Keys and values that the description must have.

    Raises:
        DatasetError: If a value differs.
    """
    here, wanted = _flat({key: found.get(key) for key in asked}), _flat(asked)
    for key in wanted | here:  # a key that only one of them has is a difference, too
        if here.get(key) != wanted.get(key):
            its, asked_for = printable(repr(here.get(key)), 200), printable(repr(wanted.get(key)), 200)
            raise DatasetError(
                f"{path} holds another dataset: its {printable(key, 200)} is {its}, asked for {asked_for}; "
                "name another folder"
            )


def _flat(value: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, item in value.items():
        flat |= _flat(item, f"{prefix}{key}.") if isinstance(item, dict) else {f"{prefix}{key}": item}
    return flat
