"""The contents of a ``torch.export`` program, read from its file without pickle and without PyTorch's own reader.

`torch.export.load` unpickles whatever a file holds, evaluates its symbolic expressions as Python, and runs compiled
libraries in it. Here the file is an archive of stored members, of which three kinds are read: the graph, which is JSON
of a declared form; weights and constants, which are raw numbers; and texts. All other members are ignored.

The form is that of ``torch/_export/serde/schema.py``, version 8 (PyTorch 2.13).
"""

import math
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import msgspec
import torch
from torch import Tensor

from svfl_data.errors import FormatError
from svfl_data.system.printable import printable
from svfl_data.system.stored_zip import Stored, stored

GRAPH = "models/model.json"
PAYLOADS = (
    ("data/weights/", "data/weights/model_weights_config.json"),
    ("data/constants/", "data/constants/model_constants_config.json"),
)
EXTRA = "extra/"
KNOWN = ("models/", "data/weights/", "data/constants/", "data/sample_inputs/", EXTRA, ".data/")
KNOWN_ALONE = ("archive_format", "archive_version", "byteorder")
SCHEMA = 8
LARGEST_TEXT = 64 * 2**20
"""Most bytes of a JSON member that is parsed."""
DTYPES = {
    1: torch.uint8, 2: torch.int8, 3: torch.int16, 4: torch.int32, 5: torch.int64, 6: torch.float16, 7: torch.float32,
    8: torch.float64, 12: torch.bool, 13: torch.bfloat16,
}  # fmt: skip
"""PyTorch's types of numbers by their codes in the schema."""


class Named(msgspec.Struct):
    """A reference to a tensor by its name."""

    name: str


class Argument(msgspec.Struct):
    """An argument of an operator, with the name of its parameter; `kind` 2 means a keyword argument."""

    name: str
    arg: dict[str, Any]
    kind: int | None = None


class Step(msgspec.Struct):
    """A step of a program: the name of an operator, its arguments, and the names of its results."""

    target: str
    inputs: list[Argument]
    outputs: list[dict[str, Any]]


class Size(msgspec.Struct):
    """A size: a known number or an expression, such as one of the number of samples, which is never evaluated."""

    as_int: int | None = None
    as_expr: Any = None


class Meta(msgspec.Struct):
    """The form of a tensor: code of its type of numbers (`DTYPES`), sizes, strides and offset in its storage."""

    dtype: int
    sizes: list[Size]
    strides: list[Size]
    storage_offset: Size


class Graph(msgspec.Struct):
    """The steps of a program, and the forms of its tensors by name."""

    nodes: list[Step]
    tensor_values: dict[str, Meta]


class UserValue(msgspec.Struct):
    """An input or output of a program that the user gives or gets."""

    arg: dict[str, Any]


class Parameter(msgspec.Struct):
    """An input that is a learned weight of the network."""

    arg: Named
    parameter_name: str


class Buffer(msgspec.Struct):
    """An input that is a buffer of the network: a tensor that is stored with the weights but not learned."""

    arg: Named
    buffer_name: str


class Constant(msgspec.Struct):
    """An input that is a constant tensor."""

    arg: Named
    tensor_constant_name: str


class Input(msgspec.Struct, forbid_unknown_fields=True):
    """An input of a program, of one of four kinds: exactly one of the fields is expected to be set."""

    user_input: UserValue | None = None
    parameter: Parameter | None = None
    buffer: Buffer | None = None
    tensor_constant: Constant | None = None


class Output(msgspec.Struct, forbid_unknown_fields=True):
    """An output of a program; other kinds, which programs that change their own buffers have, are refused."""

    user_output: UserValue


class Signature(msgspec.Struct):
    """The inputs and outputs of a program."""

    input_specs: list[Input]
    output_specs: list[Output]


class GraphModule(msgspec.Struct):
    """The graph and the signature of a program."""

    graph: Graph
    signature: Signature


class Version(msgspec.Struct):
    """The version of the schema."""

    major: int


class Program(msgspec.Struct):
    """The content of the member `GRAPH`."""

    graph_module: GraphModule
    schema_version: Version


class Payload(msgspec.Struct):
    """The place and form of a weight's or constant's numbers: member of the archive, whether pickled, and form."""

    path_name: str
    use_pickle: bool
    tensor_meta: Meta | None


class Payloads(msgspec.Struct):
    """The content of the members that are the second entries of `PAYLOADS`, by names of weights or constants."""

    config: dict[str, Payload]


class ProgramFile:
    """The file of an exported program.

    Args:
        archive: Archive that the file consists of.

    Attributes:
        program: Graph, signature and schema version of the program.
        tensors: Weights, buffers and constants by name, on the CPU.

    Raises:
        ValueError: If the file is not an exported program, or holds something that it should not. The errors of msgspec
            are of this kind.
        KeyError: If a member is missing.
        zipfile.BadZipFile: If a member is damaged.
    """

    def __init__(self, archive: Stored) -> None:
        roots = {name.partition("/")[0] for name in archive.members}
        if len(roots) != 1:
            raise ValueError("it is no exported program")
        self._archive, self._root = archive, f"{roots.pop()}/"
        for name in archive.members:
            inside = name.removeprefix(self._root)
            if not inside.startswith(KNOWN) and inside not in KNOWN_ALONE:
                raise ValueError(f"it holds {inside!r}, which is no part of a program of tensors")
        self.program = msgspec.json.decode(self._read(GRAPH), type=Program)
        if self.program.schema_version.major != SCHEMA:
            raise ValueError(f"its schema is version {self.program.schema_version.major}, this software reads {SCHEMA}")
        self.tensors: dict[str, Tensor] = {}
        for folder, config in PAYLOADS:
            self.tensors |= self._payloads(folder, msgspec.json.decode(self._read(config), type=Payloads))

    def text(self, name: str) -> str:
        """Return the text that was exported with the program under a name.

        Raises:
            KeyError: If there is no such text.
        """
        return self._read(EXTRA + name).decode()

    def _read(self, inside: str) -> bytes:
        name = self._root + inside
        if name not in self._archive.members:
            raise KeyError(f"it has no {inside}")
        if inside.endswith(".json") and self._archive.members[name] > LARGEST_TEXT:
            raise ValueError(f"{inside} is larger than {LARGEST_TEXT} bytes")
        return self._archive.read(name)

    def _payloads(self, folder: str, payloads: Payloads) -> dict[str, Tensor]:
        contents: dict[str, bytearray] = {}
        found = {}
        for name, payload in payloads.config.items():
            if payload.use_pickle or payload.tensor_meta is None:
                raise ValueError(f"{name} is pickled; only plain numbers are read")
            if payload.path_name not in contents:
                contents[payload.path_name] = bytearray(self._read(folder + payload.path_name))
            found[name] = _tensor(name, contents[payload.path_name], payload.tensor_meta)
        return found


def text_of(path: Path, name: str) -> str | None:
    """Return a text that a program's file holds, without reading the program; None if there is no such text.

    Args:
        path: File of the program (``.pt2``).
        name: Name of the text.

    Raises:
        FormatError: If the file is missing or not an archive as programs are, or the text is too long or no text.
    """
    try:
        with stored(path) as archive:
            for member, size in archive.members.items():
                if member.partition("/")[2] == EXTRA + name:
                    if size > LARGEST_TEXT:
                        raise FormatError(f"{path}: {name} in it is larger than {LARGEST_TEXT} bytes")
                    return archive.read(member).decode()
    except FileNotFoundError as error:
        raise FormatError(f"{path}: no such file") from error
    except (OSError, BadZipFile, UnicodeDecodeError) as error:
        raise FormatError(f"{path}: not a readable file of a program ({printable(error, 200)})") from error
    return None


def _tensor(name: str, content: bytearray, meta: Meta) -> Tensor:
    """Return a tensor as a view of its member's bytes, so that tensors which share a member share memory here, too."""
    dtype = DTYPES.get(meta.dtype)
    if dtype is None:
        raise ValueError(f"{name} is of no type that is read (code {meta.dtype})")
    sizes, strides = _known(name, meta.sizes), _known(name, meta.strides)
    (offset,) = _known(name, [meta.storage_offset])
    held = len(content) // dtype.itemsize
    reach = 0 if 0 in sizes else 1 + offset + sum((n - 1) * step for n, step in zip(sizes, strides, strict=True))
    if reach > held or math.prod(sizes) > held:
        raise ValueError(f"{name} is declared with {math.prod(sizes)} numbers, the file holds {held}")
    flat = torch.frombuffer(content, dtype=dtype, count=held) if held else torch.empty(0, dtype=dtype)
    tensor = flat.as_strided(sizes, strides, offset)
    if not torch.isfinite(tensor).all():
        raise ValueError(f"{name} has numbers that are not finite")
    return tensor


def _known(name: str, sizes: list[Size]) -> list[int]:
    if any(size.as_int is None or not 0 <= size.as_int < 2**48 for size in sizes):
        raise ValueError(f"{name} has no size")
    return [size.as_int for size in sizes if size.as_int is not None]
