"""Opening what a training has written, with one clear line about what is wrong with a file that is none.

A checkpoint may come from anybody: nothing in it is run, and it gets no more memory than the file has bytes. PyTorch
reads it with its restricted unpickler, which builds tensors and plain values only; the archive around it is checked
before (`svfl_data.system.stored_zip`), the sizes that it declares afterwards.
"""

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar
from zipfile import BadZipFile

import msgspec
import torch
from torch import Tensor, nn

from svfl_data.errors import FormatError
from svfl_data.system.printable import printable
from svfl_data.system.stored_zip import stored

Module = TypeVar("Module", bound=nn.Module)
LARGEST = 4096
"""Largest size that the description of a network may name; ours have widths up to some hundreds."""
DEEPEST, LONGEST = 6, 64
"""Levels of a description, and values in each of its lists."""


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
    found = read(path)
    mark = _mark(found)
    if mark is None or mark.get("format") != name:
        marked = "no mark of svfl-train" if mark is None else mark.get("format", "nothing")
        raise FormatError(f"{path}: not a {what} (found {printable(marked, 40)}, expected {name})")
    if str(mark.get("format_version")).partition(".")[0] != version.partition(".")[0]:
        marked = printable(mark.get("format_version"), 40)
        raise FormatError(f"{path}: format version {marked}; this release reads {version}; train it again")
    return dict(found)


def is_marked(path: Path, name: str) -> bool:
    """Whether a file is marked as a checkpoint of a format; false also if it cannot be read."""
    try:
        mark = _mark(read(path))
    except FormatError:
        return False
    return mark is not None and mark.get("format") == name


def rebuilt(kind: type[Module], found: dict[str, Any], path: Path, training: type) -> Module:
    """The module whose weights and description a checkpoint holds, in eval mode, on the CPU.

    Args:
        kind: Its class.
        found: What `read_marked` has read.
        path: From where, for the message.
        training: Class of the configuration that the module was trained with, if it says so.

    Raises:
        FormatError: If the weights do not fit their own description, are not finite, or the description is none.
    """
    try:
        described, state = found["hyper_parameters"], found["state_dict"]
        msgspec.convert(described.get("training"), training | None)
        _check_modest(described)
        _check_tensors(state, path)
        _check_shapes(kind, described, state)
        module = kind(**described)
        _check_types(module, state)
        module.load_state_dict(state)
    except FormatError:
        raise
    except Exception as error:  # whatever networks and PyTorch raise when they are given something else
        raise FormatError(f"{path}: weights and description do not fit each other: {_short(error)}") from error
    return module.eval()


def read(path: Path) -> Any:  # noqa: ANN401 - whatever the file holds
    """What a file of `torch.save` holds: tensors on the CPU and plain values; nothing in it is run.

    Raises:
        FormatError: If it is missing, no such file, or damaged.
    """
    if not path.exists():
        raise FormatError(f"{path}: no such file")
    try:
        with stored(path) as archive, warnings.catch_warnings():
            warnings.simplefilter("ignore")  # what is wrong is said below
            return torch.load(archive.file, map_location="cpu", weights_only=True)
    except FormatError:
        raise
    except BadZipFile as error:
        raise FormatError(f"{path}: not a checkpoint (or one that is cut off): {_short(error)}") from error
    except Exception as error:  # its unpickler raises nearly anything
        raise FormatError(f"{path}: not readable as a checkpoint: {_short(error)}") from error


def _check_modest(described: Mapping[str, Any]) -> None:
    """Refuse a network of sizes that nobody trains, before anything of these sizes is built."""
    inside = [("the description", described["network"], 0)]
    while inside:
        name, value, depth = inside.pop()
        few = depth <= DEEPEST and (not isinstance(value, Mapping | list | tuple | str) or len(value) <= LONGEST)
        if not few or (isinstance(value, int) and not 0 <= value <= LARGEST):
            raise ValueError(f"{name} of the network is too large ({printable(value, 40)})")
        if isinstance(value, Mapping):
            inside += [(str(key), one, depth + 1) for key, one in value.items()]
        elif isinstance(value, list | tuple):
            inside += [(name, one, depth + 1) for one in value]


def _check_tensors(state: Mapping[str, Any], path: Path) -> None:
    """Refuse tensors that are larger than what the file holds of them, and weights that are no numbers."""
    for key, tensor in state.items():
        name = printable(key, 80)
        if not isinstance(tensor, Tensor) or tensor.layout != torch.strided or tensor.device.type != "cpu":
            raise FormatError(f"{path}: {name} is no tensor of plain numbers")
        held = tensor.untyped_storage().nbytes() // tensor.element_size()
        if tensor.numel() > held:
            raise FormatError(f"{path}: {name} is declared with {tensor.numel()} numbers, the file holds {held}")
        if not torch.isfinite(tensor).all():
            raise FormatError(f"{path}: {name} has numbers that are not finite")


def _check_types(module: Module, state: Mapping[str, Tensor]) -> None:
    """Compare with what was built: PyTorch would convert whatever it is given, complex numbers with a loss."""
    for name, tensor in module.state_dict().items():
        if name in state and state[name].dtype != tensor.dtype:
            raise ValueError(f"{name} holds {state[name].dtype}, described is {tensor.dtype}")


def _check_shapes(kind: type[Module], described: Mapping[str, Any], state: Mapping[str, Tensor]) -> None:
    """Compare with what the description would build, without memory for it."""
    try:
        with torch.device("meta"):
            built = kind(**described).state_dict()
    except NotImplementedError:
        return  # symmetric layers compute their kernels as they are built; such networks have the sizes of presets
    for name, tensor in built.items():
        if name in state and state[name].shape != tensor.shape:
            raise ValueError(f"{name} has shape {tuple(state[name].shape)}, described is {tuple(tensor.shape)}")


def _mark(found: object) -> dict[str, Any] | None:
    mark = found.get("svfl") if isinstance(found, dict) else None
    return mark if isinstance(mark, dict) else None


def _short(error: Exception) -> str:
    return printable(" ".join(str(error).split()) or type(error).__name__, 200)
