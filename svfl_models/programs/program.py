"""Running an exported program step by step, with operators from a list and nothing else (`operators`).

This, `program_file` and `operators` need PyTorch and msgspec, not escnn and not the networks of this package.
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
"""Most numbers that a program may hold at once for one sample."""
MEMORY_FORMATS = {
    1: torch.contiguous_format,
    2: torch.channels_last,
    3: torch.channels_last_3d,
    4: torch.preserve_format,
}
TOLERANCE = 1e-5
"""Largest difference between an exported file and its network, relative to the largest output, that is rounding."""
INFINITE = ("Infinity", "-Infinity")
KEYWORD = 2
META = torch.device("meta")


class _Value(str):
    """Name of a value that a step gives, where an operator takes it."""

    __slots__ = ()


class Program:
    """An exported program: called with its inputs in their order, it gives its outputs.

    Args:
        file: What it is read from.

    Attributes:
        inputs: Shape of each input; 1 where it takes any number.
        outputs: Shape of each output, for such inputs.

    Raises:
        ValueError: If it uses an operator that it may not, fits together badly, or needs too much memory.
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

    def to(self, device: torch.device) -> "Program":
        """Bring it to a device; returns itself."""
        self._device, self._kept = device, {name: tensor.to(device) for name, tensor in self._kept.items()}
        return self

    def __call__(self, *inputs: Tensor) -> list[Tensor]:
        """Run it, on inputs on its device."""
        values = self._kept | dict(zip(self._inputs, inputs, strict=True))
        for step in self._steps:
            step(values, self._device)
            for name in step.last:
                del values[name]
        return [values[name] for name in self._outputs]

    def _check_memory(self, values: dict[str, Tensor]) -> dict[str, Tensor]:
        """Go through all steps with shapes only; returns what is left at the end.

        Raises:
            ValueError: If too much would be held at once.
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
    """One operator at work.

    Attributes:
        last: Names of the values that no later step needs.
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
        """Names of the values that it takes."""
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
        path: The file.
        text: Name of the text.

    Raises:
        FormatError: If the file is missing, damaged, no program, or one that may not be run.
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
    """As `read`, of a network that was exported just now.

    Raises:
        TrainingError: If it does what a program may not.
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
    """Tell each step which values it is the last to need."""
    needed = set(kept)
    for step in reversed(steps):
        step.last = sorted((step.needs | set(step.names)) - needed)
        needed |= step.needs


def _filled(value: object, values: dict[str, Any], device: torch.device) -> object:
    """An argument with names replaced by what they stand for."""
    if isinstance(value, _Value):
        return values[value]
    if isinstance(value, list):
        return [values[one] if isinstance(one, _Value) else one for one in value]
    return device if isinstance(value, torch.device) else value


def _plain(argument: dict[str, Any]) -> object:
    """An argument of an operator, from the schema's union."""
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
            return torch.device("cpu")  # replaced by that of the program
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
