"""Reading of what an exported ONNX file says of itself, without running it and without reading any other file."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from svfl_data.errors import FormatError, TrainingError
from svfl_data.system.printable import printable
from svfl_data.system.regular_file import read_regular

LARGEST = 2**31 - 1
"""Most bytes of a file that is read, which are the most that the format (protobuf) allows."""


@dataclass(frozen=True)
class OnnxFile:
    """What an ONNX file says of itself.

    Attributes:
        texts: Texts that were kept in the file, by name.
        inputs: Shape of each input by name, without the number of samples.
        outputs: Shape of each output by name, without the number of samples.
        numbers: Number of weights and constants.
    """

    texts: dict[str, str]
    inputs: dict[str, tuple[int, ...]]
    outputs: dict[str, tuple[int, ...]]
    numbers: int


def read_onnx(path: Path) -> OnnxFile:
    """Read an ONNX file that ``svfl-train export`` has written.

    Args:
        path: File to read. A link to a file is followed.

    Raises:
        FormatError: If the file is missing or damaged, keeps weights in other files, which are not read, has weights
            that are not finite or fewer than it declares, or has an input or output without a size.
        TrainingError: If the package ``onnx`` is missing.
    """
    try:
        import onnx  # an extra of its own
    except ImportError as error:
        raise missing(error) from error
    try:
        model = onnx.load_model_from_string(read_regular(path.resolve(), LARGEST))
        found = list(_tensors(model, onnx.TensorProto))
        elsewhere = next((one for one in found if one.data_location == onnx.TensorProto.EXTERNAL), None)
        if elsewhere is not None:
            raise FormatError(f"{path}: {printable(elsewhere.name, 80)} lies in another file, which is not read")
        for one in found:
            _check(one, path, onnx.numpy_helper.to_array)
        graph = model.graph
        given = {one.name for one in graph.initializer}  # older files list weights among the inputs, too
        return OnnxFile(
            {one.key: one.value for one in model.metadata_props},
            {one.name: _shape(one, path) for one in graph.input if one.name not in given},
            {one.name: _shape(one, path) for one in graph.output},
            sum(math.prod(one.dims) for one in found),
        )
    except FileNotFoundError as error:
        raise FormatError(f"{path}: no such file") from error
    except OSError as error:
        raise FormatError(f"{path}: cannot be read ({error.strerror or error})") from error
    except FormatError:
        raise
    except Exception as error:  # protobuf's reader has errors of its own
        raise FormatError(f"{path}: not a readable ONNX file ({printable(error, 200)})") from error


def missing(error: ImportError) -> TrainingError:
    """Return the error that says how to install what ONNX needs.

    Args:
        error: The import that failed.
    """
    return TrainingError(f"ONNX needs a package that is missing here ({error}); run: pip install 'svfl[onnx]'")


def _tensors(message: Any, kind: type) -> Iterator[Any]:  # noqa: ANN401 - protobuf's types
    """Yield all tensors in a message of protobuf, however deep they lie."""
    for field, value in message.ListFields():
        if field.message_type is not None:
            for one in [value] if hasattr(value, "ListFields") else value:
                if isinstance(one, kind):
                    yield one
                else:
                    yield from _tensors(one, kind)


def _check(tensor: Any, path: Path, to_array: Any) -> None:  # noqa: ANN401 - protobuf's types
    """Refuse a tensor that declares more numbers than it holds, or holds some that are not finite."""
    name = printable(tensor.name, 80)
    try:
        values = to_array(tensor)
    except Exception as error:
        raise FormatError(f"{path}: {name} does not hold the numbers that it declares") from error
    if np.issubdtype(values.dtype, np.floating) and not np.isfinite(values).all():
        raise FormatError(f"{path}: {name} has numbers that are not finite")


def _shape(value: Any, path: Path) -> tuple[int, ...]:  # noqa: ANN401 - protobuf's types
    """Return the shape of an input or output, whose first dimension is the number of samples."""
    sizes = [one.dim_value for one in value.type.tensor_type.shape.dim][1:]
    if not sizes or any(size <= 0 for size in sizes):
        raise FormatError(f"{path}: {printable(value.name, 80)} has no size")
    return tuple(sizes)
