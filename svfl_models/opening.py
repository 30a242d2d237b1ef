"""Opening what a training has written, with one clear line about what is wrong with a file that is none."""

import pickle
from pathlib import Path
from typing import Any, TypeVar
from zipfile import is_zipfile

import torch
from torch import nn

from svfl_data.errors import FormatError, SvflError

Module = TypeVar("Module", bound=nn.Module)


def read_marked(path: Path, name: str, version: str, what: str) -> dict[str, Any]:
    """What a checkpoint holds, its mark checked.

    Args:
        path: The file.
        name: Format that it must be marked with.
        version: Ours, of which the major part must be the file's.
        what: Which checkpoint it should be, in words.

    Raises:
        FormatError: If the file is missing, damaged, of another program or of another version.
    """
    found = _read(path)
    mark = _mark(found)
    if mark is None or mark.get("format") != name:
        kind = "no mark of svfl-train" if mark is None else mark.get("format", "nothing")
        raise FormatError(f"{path}: not a {what} (found {kind}, expected {name})")
    if str(mark.get("format_version")).partition(".")[0] != version.partition(".")[0]:
        raise FormatError(
            f"{path}: format version {mark.get('format_version')}; this release reads {version}; train it again"
        )
    return dict(found)


def is_marked(path: Path, name: str) -> bool:
    """Whether a file is marked as a checkpoint of a format; false also if it cannot be read."""
    try:
        mark = _mark(_read(path))
    except FormatError:
        return False
    return mark is not None and mark.get("format") == name


def rebuilt(kind: type[Module], found: dict[str, Any], path: Path) -> Module:
    """The module whose weights and description a checkpoint holds, in eval mode, on the CPU.

    Args:
        kind: Its class.
        found: What `read_marked` has read.
        path: From where, for the message.

    Raises:
        FormatError: If the weights do not fit their own description.
    """
    try:
        module = kind(**found["hyper_parameters"])
        module.load_state_dict(found["state_dict"])
    except (KeyError, TypeError, RuntimeError, SvflError) as error:
        raise FormatError(f"{path}: weights and description do not fit each other: {_short(error)}") from error
    return module.eval()


def _read(path: Path) -> Any:  # noqa: ANN401 - whatever the file holds
    if not path.is_file():
        raise FormatError(f"{path}: no such file")
    if not is_zipfile(path):
        raise FormatError(f"{path}: not a checkpoint (or one that is cut off)")
    try:
        return torch.load(path, map_location="cpu", weights_only=True)
    except (RuntimeError, pickle.UnpicklingError, OSError, EOFError, KeyError) as error:
        raise FormatError(f"{path}: not readable as a checkpoint: {_short(error)}") from error


def _mark(found: object) -> dict[str, Any] | None:
    mark = found.get("svfl") if isinstance(found, dict) else None
    return mark if isinstance(mark, dict) else None


def _short(error: Exception) -> str:
    return " ".join(str(error).split())[:200]
