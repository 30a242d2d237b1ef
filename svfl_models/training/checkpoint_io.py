"""Reading of checkpoints, with a one-line message if a file is not a valid checkpoint.

A checkpoint may come from anybody. Nothing in it is run, and its tensors get no more memory than the file has bytes.
PyTorch reads it with its restricted unpickler, which builds tensors and plain values only. The archive around it is
checked before that (`svfl_data.system.stored_zip`), and the sizes that it declares are checked afterwards.
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
from svfl_models.networks.input_types import ImageInput, SequenceInput, inputs_of_plain
from svfl_models.networks.presets import Widths

Module = TypeVar("Module", bound=nn.Module)
LARGEST = 4096
"""Largest integer in the description of a network; the widths of our own networks are at most some hundreds."""
DEEPEST, LONGEST = 8, 64
"""Most levels of nesting in the description of a network, and most values in each of its lists, mappings and texts."""


def read_marked(path: Path, name: str, version: str, what: str) -> dict[str, Any]:
    """Read a checkpoint and check its mark, which names its format and version.

    Args:
        path: File of the checkpoint.
        name: Name of the format that the checkpoint must be marked with.
        version: Format version of this release. The file's version must have the same major part.
        what: Kind of checkpoint that is expected, in words, for the message.

    Returns:
        The content of the checkpoint.

    Raises:
        FormatError: If the file is missing, damaged, of another program or of another version.
    """
    found = read(path)
    mark = mark_of(found)
    if mark is None or mark.get("format") != name:
        marked = "no mark of svfl-train" if mark is None else mark.get("format", "nothing")
        raise FormatError(f"{path}: not a {what} (found {printable(marked, 40)}, expected {name})")
    if str(mark.get("format_version")).partition(".")[0] != version.partition(".")[0]:
        marked = printable(mark.get("format_version"), 40)
        raise FormatError(f"{path}: format version {marked}; this release reads {version}; train it again")
    return dict(found)


def is_marked(path: Path, name: str) -> bool:
    """Return whether a file is marked as a checkpoint of a format; false also if the file cannot be read.

    Args:
        path: File of the checkpoint.
        name: Name of the format.
    """
    try:
        mark = mark_of(read(path))
    except FormatError:
        return False
    return mark is not None and mark.get("format") == name


def rebuilt(kind: type[Module], found: dict[str, Any], path: Path, training: type) -> Module:
    """Build the module whose description and weights a checkpoint holds.

    Args:
        kind: Class of the module.
        found: Content of the checkpoint, as `read_marked` returns it.
        path: File of the checkpoint, for the message.
        training: Class of the training's configuration, which the description may hold.

    Returns:
        The module, in eval mode, on the CPU.

    Raises:
        FormatError: If the description is missing or invalid, or the weights do not fit it or are not finite.
    """
    try:
        described, state = found["hyper_parameters"], found["state_dict"]
        msgspec.convert(described.get("training"), training | None)
        _check_modest(described)
        _check_tensors(state, path)
        _check_widths(described["network"], state)
        _check_shapes(kind, described, state)
        module = kind(**described)
        _check_types(module, state)
        module.load_state_dict(state)
    except FormatError:
        raise
    except Exception as error:  # networks and PyTorch raise nearly anything if the description is invalid
        raise FormatError(f"{path}: weights and description do not fit each other: {_short(error)}") from error
    return module.eval()


def read(path: Path) -> Any:  # noqa: ANN401 - whatever the file holds
    """Read a file that `torch.save` wrote, without running anything in it.

    Args:
        path: File to read.

    Returns:
        The content of the file: tensors on the CPU and plain values.

    Raises:
        FormatError: If the file is missing, damaged, or not written by `torch.save`.
    """
    if not path.exists():
        raise FormatError(f"{path}: no such file")
    try:
        with stored(path) as archive, warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the errors below say what is wrong
            return torch.load(archive.file, map_location="cpu", weights_only=True)
    except FormatError:
        raise
    except BadZipFile as error:
        raise FormatError(f"{path}: not a checkpoint (or one that is cut off): {_short(error)}") from error
    except Exception as error:  # PyTorch's unpickler raises nearly anything
        raise FormatError(f"{path}: not readable as a checkpoint: {_short(error)}") from error


def _check_modest(described: Mapping[str, Any]) -> None:
    """Refuse a description with sizes that no trained network has, before anything of these sizes is built."""
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


def _check_widths(network: Mapping[str, Any], state: Mapping[str, Tensor]) -> None:
    """Refuse layers that must have more weights than there are, before memory is taken for them."""
    if network.get("widths") is None or network.get("latent_network"):
        return  # a latent encoder has sizes of its own, which are built without memory
    kinds = {ImageInput: "v", SequenceInput: "f"}
    inputs = inputs_of_plain(network["inputs"]) if network.get("inputs") else ()
    letters = "".join(kinds.get(type(one), "p") for one in inputs) or network["encoder"]
    fewest = Widths.of_plain(network["widths"]).fewest_weights(letters)
    held = sum(tensor.numel() for tensor in state.values())
    if fewest > held:
        raise ValueError(f"layers of these widths have at least {fewest} weights, the file holds {held}")


def _check_tensors(state: Mapping[str, Any], path: Path) -> None:
    """Refuse weights that are not plain tensors or not finite, or that declare more numbers than the file holds."""
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
    """Refuse weights whose dtype is not the built module's, because PyTorch would convert them, even with a loss."""
    for name, tensor in module.state_dict().items():
        if name in state and state[name].dtype != tensor.dtype:
            raise ValueError(f"{name} holds {state[name].dtype}, described is {tensor.dtype}")


def _check_shapes(kind: type[Module], described: Mapping[str, Any], state: Mapping[str, Tensor]) -> None:
    """Refuse weights whose shapes are not those of the described network, which is built without memory for that."""
    try:
        with torch.device("meta"):
            built = kind(**described).state_dict()
    except NotImplementedError:
        return  # symmetric layers compute kernels when they are built, so need memory; `_check_widths` bounds it
    for name, tensor in built.items():
        if name in state and state[name].shape != tensor.shape:
            raise ValueError(f"{name} has shape {tuple(state[name].shape)}, described is {tuple(tensor.shape)}")


def mark_of(found: object) -> dict[str, Any] | None:
    """Return the mark of a checkpoint, which names its format and version; None if it has none.

    Args:
        found: Content of a file, as `read` returns it.
    """
    mark = found.get("svfl") if isinstance(found, dict) else None
    return mark if isinstance(mark, dict) else None


def _short(error: Exception) -> str:
    return printable(" ".join(str(error).split()) or type(error).__name__, 200)
