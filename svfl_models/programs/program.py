"""Running of an exported program step by step, with operators from a list only (see `operators`).

The modules `program`, `program_file` and `operators` need PyTorch and msgspec, but neither escnn nor the networks of
this package.
"""

import io
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import torch
from torch import Tensor

from svfl_data.errors import FormatError, TrainingError
from svfl_data.system.printable import printable
from svfl_data.system.stored_zip import Stored, stored
from svfl_models.programs.operators import is_check, operator
from svfl_models.programs.program_file import DTYPES, Input, Named, ProgramFile, Size, Step

LARGEST = 2**28
"""Most numbers that the tensors of a program may hold at the same time, for one sample."""
MEMORY_FORMATS = {
    1: torch.contiguous_format,
    2: torch.channels_last,
    3: torch.channels_last_3d,
    4: torch.preserve_format,
}
TOLERANCE = 1e-5
"""Largest difference between the outputs of an exported file and of its network that counts as rounding, relative to
the largest output."""
INFINITE = ("Infinity", "-Infinity")
KEYWORD = 2
META = torch.device("meta")


class _Value(str):
    """Name of a tensor, where an operator takes this tensor as an argument."""

    __slots__ = ()


class Program:
    """An exported program that, when called with its inputs in their order, returns its outputs.

    Args:
        file: File that the program is read from.

    Attributes:
        inputs: Shape of each input. A size is 1 where the program takes any size.
        outputs: Shape of each output, for inputs of these shapes.

    Raises:
        ValueError: If the program uses an operator that is not allowed, is inconsistent, or needs too much memory.
    """

    def __init__(self, file: ProgramFile) -> None:
        module = file.program.graph_module
        names = [_name_of(one) for one in module.signature.input_specs]
        self._inputs = [name for name, one in zip(names, module.signature.input_specs, strict=True) if one.user_input]
        self._kept = {
            name: file.tensors[_stored_name(one)]
            for name, one in zip(names, module.signature.input_specs, strict=True)
            if not one.user_input
        }
        self._outputs = [_tensor_name(one.user_output.arg) for one in module.signature.output_specs]
        self._device = torch.device("cpu")
        self._steps = [_Step(step) for step in module.graph.nodes if not is_check(step.target)]
        _let_go(self._steps, {*self._outputs, *self._kept})
        forms = module.graph.tensor_values
        self.inputs = [tuple(_size(size) for size in forms[name].sizes) for name in self._inputs]
        dtypes = [DTYPES[forms[name].dtype] for name in self._inputs]
        given = [torch.empty(shape, dtype=dtype, device=META) for shape, dtype in zip(self.inputs, dtypes, strict=True)]
        meta = {name: tensor.to(META) for name, tensor in self._kept.items()}
        left = self._check_memory(meta | dict(zip(self._inputs, given, strict=True)))
        self.outputs = [tuple(left[name].shape) for name in self._outputs]

    @property
    def numbers(self) -> int:
        """Number of weights and constants that the program holds."""
        return sum(tensor.numel() for tensor in self._kept.values())

    def to(self, device: torch.device) -> "Program":
        """Move the program to a device, and return the program itself."""
        self._device, self._kept = device, {name: tensor.to(device) for name, tensor in self._kept.items()}
        return self

    def __call__(self, *inputs: Tensor) -> list[Tensor]:
        """Run the program on inputs that are on its device, and return its outputs."""
        values = self._kept | dict(zip(self._inputs, inputs, strict=True))
        for step in self._steps:
            step(values, self._device)
            for name in step.last:
                del values[name]
        return [values[name] for name in self._outputs]

    def _check_memory(self, values: dict[str, Tensor]) -> dict[str, Tensor]:
        """Run all steps on tensors without data, and return the tensors that are left at the end.

        Raises:
            ValueError: If the tensors would hold more than `LARGEST` numbers at the same time.
        """
        together = sum(value.numel() for value in values.values())
        for step in self._steps:
            step(values, META)
            together += sum(values[name].numel() for name in step.names)
            if together > LARGEST:
                raise ValueError(f"it needs room for {together} numbers at once; at most {LARGEST} are allowed")
            together -= sum(values.pop(name).numel() for name in step.last)
        return values


class _Step:
    """One step of a program: an operator with its arguments.

    Attributes:
        names: Names of the values that the step produces.
        last: Names of the values that no later step needs, and that are deleted after this step.
    """

    def __init__(self, step: Step) -> None:
        found = operator(step.target)
        if found is None:
            raise ValueError(f"it uses {step.target}, which a program may not")
        self._operator: Callable[..., Any] = found
        self._positional = [_plain(one.arg) for one in step.inputs if one.kind != KEYWORD]
        self._keywords = {one.name: _plain(one.arg) for one in step.inputs if one.kind == KEYWORD}
        self._unpacked = len(step.outputs) != 1 or "as_tensors" in step.outputs[0]
        self.names = _names(step.outputs)
        self.last: list[str] = []

    @property
    def needs(self) -> set[str]:
        """Names of the values that the step takes."""
        found: set[str] = set()
        for value in (*self._positional, *self._keywords.values()):
            found |= {str(one) for one in (value if isinstance(value, list) else [value]) if isinstance(one, _Value)}
        return found

    def __call__(self, values: dict[str, Any], device: torch.device) -> None:
        positional = [_filled(value, values, device) for value in self._positional]
        keywords = {name: _filled(value, values, device) for name, value in self._keywords.items()}
        given = self._operator(*positional, **keywords)
        values.update(zip(self.names, given if self._unpacked else (given,), strict=True))


def read(path: Path | str, text: str) -> tuple[Program, str]:
    """Read a program, and a text that was exported with it.

    Args:
        path: File of the program (``.pt2``).
        text: Name of the text inside the file.

    Returns:
        The program, on the CPU, and the content of the text.

    Raises:
        FormatError: If the file is missing, damaged, not a program, or a program that may not be run.
    """
    path = Path(path)
    if not path.exists():
        raise FormatError(f"{path}: no such file")
    try:
        with stored(path) as archive:
            return _read(archive, text)
    except FormatError:
        raise
    except Exception as error:  # operators raise nearly anything
        raise FormatError(f"{path}: not an exported program that can be run: {_words(error)}") from error


def from_bytes(content: bytes, text: str) -> tuple[Program, str]:
    """Read a program and a text from the content of a file, for a network that was just exported.

    Args:
        content: Content of the file.
        text: Name of the text inside the file.

    Returns:
        The program, on the CPU, and the content of the text.

    Raises:
        TrainingError: If the program may not be run, for instance because of its operators.
    """
    try:
        return _read(Stored(io.BytesIO(content)), text)
    except Exception as error:
        raise TrainingError(f"this network cannot be exported: {_words(error)}") from error


def _read(archive: Stored, text: str) -> tuple[Program, str]:
    file = ProgramFile(archive)
    with torch.inference_mode():
        return Program(file), file.text(text)


def _words(error: Exception) -> str:
    return printable(" ".join(str(error.args[0] if isinstance(error, KeyError) else error).split()), 200)


def _let_go(steps: list[_Step], kept: set[str]) -> None:
    """Set `last` of each step to the values that no later step needs and that are not in `kept`."""
    needed = set(kept)
    for step in reversed(steps):
        step.last = sorted((step.needs | set(step.names)) - needed)
        needed |= step.needs


def _filled(value: object, values: dict[str, Any], device: torch.device) -> object:
    """Return an argument in which names of values are replaced by the values, and a device by the program's."""
    if isinstance(value, _Value):
        return values[value]
    if isinstance(value, list):
        return [values[one] if isinstance(one, _Value) else one for one in value]
    return device if isinstance(value, torch.device) else value


def _plain(argument: dict[str, Any]) -> object:
    """Return an operator's argument as a Python value, a list of such values, or the name of a tensor (`_Value`)."""
    ((kind, value),) = argument.items()
    match kind:
        case "as_none":
            return None
        case "as_int" | "as_bool" | "as_string":
            return msgspec.convert(value, int | bool | str)
        case "as_float":
            return float(value) if value in INFINITE else msgspec.convert(value, float)
        case "as_ints" | "as_floats" | "as_bools":
            return msgspec.convert(value, list[bool | int | float])
        case "as_tensor":
            return _Value(msgspec.convert(value, Named).name)
        case "as_tensors":
            return [_Value(one.name) for one in msgspec.convert(value, list[Named])]
        case "as_optional_tensor":
            return _plain(value)
        case "as_optional_tensors":
            return [_plain(one) for one in value]
        case "as_scalar_type":
            return DTYPES[value]
        case "as_memory_format":
            return MEMORY_FORMATS[value]
        case "as_layout":
            return torch.strided
        case "as_device":
            return torch.device("cpu")  # replaced by the program's device in `_filled`
    raise ValueError(f"it has an argument of kind {kind}")


def _name_of(one: Input) -> str:
    if one.user_input:
        return _tensor_name(one.user_input.arg)
    found = one.parameter or one.buffer or one.tensor_constant
    if found is None:
        raise ValueError("it has an input of another kind")
    return found.arg.name


def _stored_name(one: Input) -> str:
    if one.parameter:
        return one.parameter.parameter_name
    return one.buffer.buffer_name if one.buffer else one.tensor_constant.tensor_constant_name  # type: ignore[union-attr]


def _tensor_name(argument: dict[str, Any]) -> str:
    return msgspec.convert(argument.get("as_tensor"), Named).name


def _names(outputs: list[dict[str, Any]]) -> list[str]:
    if len(outputs) == 1 and "as_tensors" in outputs[0]:
        return [one.name for one in msgspec.convert(outputs[0]["as_tensors"], list[Named])]
    return [_tensor_name(one) for one in outputs]


def _size(size: Size) -> int:
    number = 1 if size.as_int is None else size.as_int
    if not 0 <= number < math.isqrt(2**62):
        raise ValueError(f"it takes inputs of size {number}")
    return number
