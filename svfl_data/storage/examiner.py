"""Program that reads the content of a file with the HDF5 library: places, types, shapes and attributes of its arrays.

A malicious file can make the library crash, hang or read other files, so this module runs as a separate program, which
`svfl_data.storage.examination` starts. The program forks for each question. The new process cannot open further files
and has little memory and time. It answers and ends, so one file cannot change the answer about another one. The program
imports nothing of this package, so that it starts quickly and independently of the files in the current folder. Only a
file that a process has just written itself is examined without this program, by a call of `examine`.

A question is a line of JSON, sent with two descriptors: that of the file, and that of a pipe for the answer. An answer
is a line of JSON followed by bytes: chunk tables and the values of small arrays. Neither can contain code that is run.
"""

import gc
import io
import json
import math
import os
import re
import resource
import signal
import socket
import struct
from array import array
from collections.abc import Callable, Iterator
from typing import Any, BinaryIO

import h5py
import numpy as np
from h5py import h5a, h5d, h5g, h5l, h5o, h5p, h5s, h5t, h5z

FILTERS = ((h5z.FILTER_SHUFFLE, 1), (h5z.FILTER_DEFLATE, 2), (h5z.FILTER_FLETCHER32, 4))
"""The HDF5 filters that are allowed, in the only order that is allowed, each with its bit in a chunk table."""
DEPTH, OBJECTS = 8, 1000  # largest nesting of groups; largest number of groups and arrays in a file
TEXT, TEXTS = 2**23, 2**24  # largest size of one text attribute, and of all text attributes of a file, in bytes
VALUES = 2**24  # largest size of all arrays that cannot be read row by row, in bytes
BYTES_PER_CHUNK = 32  # bytes of a file that a chunk and its entry in an index take at least
SLICE = 2**20  # bytes of an array without chunks that are read at once
CPU_SECONDS, SECONDS = 4, 20  # limits of computing time and of total time for one question
MEMORY = 2**28  # bytes of memory for one question, in addition to the size of the file
CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f]")


class Refused(Exception):  # noqa: N818 - the file's fault, not an error of this program
    """The file holds something that is not allowed in an episode. The message says what and where."""


class Content(io.RawIOBase):
    """A range of bytes of an open file as a file object for HDF5.

    Args:
        descriptor: Descriptor of the open file.
        offset: Position of the first byte of the range in the file, [bytes].
        size: Size of the range, [bytes].
    """

    def __init__(self, descriptor: int, offset: int, size: int) -> None:
        self.descriptor, self.offset, self.size, self.position = descriptor, offset, size, 0

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Move the current position, counted from the beginning of the range, and return it."""
        self.position = {os.SEEK_SET: 0, os.SEEK_CUR: self.position, os.SEEK_END: self.size}[whence] + offset
        return self.position

    def tell(self) -> int:
        """Return the current position, counted from the beginning of the range."""
        return self.position

    def readinto(self, buffer: Any) -> int:  # noqa: ANN401 - any writable buffer
        """Fill a whole buffer from the current position.

        Raises:
            OSError: If that would need bytes from outside the range.
        """
        view = memoryview(buffer)
        if not 0 <= self.position <= self.size - len(view):
            raise OSError(f"{len(view)} bytes at {self.position}, which lie outside the file's {self.size}")
        view[:] = os.pread(self.descriptor, len(view), self.offset + self.position)
        self.position += len(view)
        return len(view)


def examine(content: BinaryIO | Content, names: list[str], meaning: list[str]) -> list[bytes]:
    """Describe a file: its attributes, and the type, shape, place and attributes of each of its arrays.

    Args:
        content: File object with the HDF5 content.
        names: Names of the attributes of the file to read.
        meaning: Names of the attributes of each array to read.

    Returns:
        The answer in pieces. The first is a line of JSON with ``attributes``, ``problem`` (empty if there is none) and
        ``arrays``. Then follow, for each array in order, its chunk table (``chunks`` rows of offset, size and filters,
        int64) or the bytes of its value (``value`` is their number).
    """
    answer: dict[str, Any] = {"attributes": {}, "arrays": [], "problem": ""}
    tail: list[bytes] = []
    size = content.seek(0, os.SEEK_END)
    try:
        with h5py.File(content, "r") as file:
            root = h5g.open(file.id, b"/")
            if file.userblock_size:
                raise Refused("begins with a user block")
            texts, values = [TEXTS], [VALUES]
            answer["attributes"] = _attributes(root, names, texts)
            for path, dataset in _datasets(root, "", {h5o.get_info(root).addr}, DEPTH):
                facts: dict[str, Any] = {"path": path}
                try:
                    facts["attributes"] = _attributes(dataset, meaning, texts)
                    facts |= _placement(dataset, size, values, tail)
                except Refused as refusal:
                    facts["problem"] = str(refusal)
                answer["arrays"].append(facts)
    except Refused as refusal:
        answer["problem"] = str(refusal)
    except MemoryError:
        answer["problem"] = "examining it takes more memory than a file of this size may need"
    except Exception as error:  # HDF5 raises nearly anything
        answer["problem"] = f"not a readable episode ({' '.join(str(error).split())})"
    return [json.dumps(answer, ensure_ascii=True, allow_nan=False).encode() + b"\n", *tail]


def damaged(content: Content, expected: list[str]) -> Iterator[bytes]:
    """Yield the paths of arrays that are gone or cannot be read, one line each, as far as HDF5 gets.

    Args:
        content: Content of a file that does not match its seal, or has none.
        expected: Dataset paths of the arrays that every episode has.
    """
    with h5py.File(content, "r") as file:
        found = dict(_datasets(h5g.open(file.id, b"/"), "", set(), DEPTH))
        gone = [path for path in expected if path not in found]
        if gone == expected:
            return  # none of the expected arrays: a file of other software
        for path in [*gone, *(path for path, dataset in found.items() if not _reads(dataset))]:
            yield f"{path}\n".encode()


def _reads(dataset: h5d.DatasetID) -> bool:
    try:
        stored = h5py.Dataset(dataset)
        if not stored.shape:
            stored[()]
            return True
        rows = max(1, SLICE // max(1, stored.dtype.itemsize * math.prod(stored.shape[1:])))
        for start in range(0, len(stored), rows):
            stored[start : start + rows]
    except Exception:  # damaged metadata makes h5py raise nearly anything
        return False
    return True


def _datasets(group: h5g.GroupID, prefix: str, seen: set[Any], depth: int) -> Iterator[tuple[str, h5d.DatasetID]]:
    """Yield path and dataset of every array below a group; refuse all but hard links, and second names of an object."""
    names: list[bytes] = []

    def note(name: bytes) -> bool:
        names.append(name)
        return len(names) + len(seen) > OBJECTS  # True stops the iteration

    if group.links.iterate(note)[0]:
        raise Refused(f"holds more than {OBJECTS} objects")
    if prefix and not names and not prefix.startswith("extra/"):
        raise Refused(f"{prefix.rstrip('/')} is a group without arrays")
    for name in names:
        path = prefix + _checked_name(name, prefix)
        link = group.links.get_info(name)
        if link.type != h5l.TYPE_HARD:
            kinds: dict[int, str] = {h5l.TYPE_SOFT: "a soft link", h5l.TYPE_EXTERNAL: "an external link"}
            raise Refused(f"{path} is {kinds.get(link.type, 'a user-defined link')}; links are not allowed")
        if link.u in seen:
            raise Refused(f"{path} is a second name of an object; each object may have only one")
        seen.add(link.u)
        item = h5o.open(group, name)
        if isinstance(item, h5g.GroupID):
            if depth == 0:
                raise Refused(f"{path} lies more than {DEPTH} groups deep")
            yield from _datasets(item, path + "/", seen, depth - 1)
        elif isinstance(item, h5d.DatasetID):
            plan = item.get_create_plist()  # checked first: asking for the shape of a virtual dataset opens files
            if plan.get_layout() == h5d.VIRTUAL:
                raise Refused(f"{path} is a virtual dataset, whose numbers lie in other files")
            if plan.get_external_count():
                raise Refused(f"{path} has external storage: its numbers lie in other files")
            yield path, item
        else:
            raise Refused(f"{path} is neither a group nor an array")


def _checked_name(name: bytes, prefix: str) -> str:
    try:
        text = name.decode()
    except UnicodeDecodeError:
        raise Refused(f"{prefix or '/'} has a name that is not UTF-8") from None
    if not text or text in (".", "..") or "/" in text or CONTROL.search(text) or len(name) > 255:
        raise Refused(f"{prefix or '/'} has an impossible name, {text[:40]!r}")
    return text


def _attributes(owner: h5g.GroupID | h5d.DatasetID, names: list[str], texts: list[int]) -> dict[str, Any]:
    """Read the named attributes that an object has; `texts` holds how many bytes of text are still allowed."""
    found = {}
    for name in names:
        try:
            attribute = h5a.open(owner, name.encode())
        except KeyError:
            continue
        found[name] = _attribute(attribute, name, texts)
    return found


def _attribute(attribute: h5a.AttrID, name: str, texts: list[int]) -> str | int | float | bool:
    kind = attribute.get_type()
    if attribute.get_space().get_simple_extent_type() != h5s.SCALAR:
        raise Refused(f"attribute {name} is not a single text or number")
    if isinstance(kind, h5t.TypeStringID):
        size = min(kind.get_size(), TEXT + 1)
        cell: Any = np.empty((), h5py.string_dtype() if kind.is_variable_str() else f"S{size}")
        attribute.read(cell)
        text: bytes = cell[()] or b""
        texts[0] -= len(text)
        if len(text) > TEXT or texts[0] < 0:
            raise Refused(f"attribute {name} is larger than the {TEXT} bytes (all: {TEXTS}) that texts may have")
        try:
            return str(text.decode())
        except UnicodeDecodeError:
            raise Refused(f"attribute {name} is not UTF-8") from None
    if not isinstance(kind, h5t.TypeIntegerID | h5t.TypeFloatID | h5t.TypeEnumID) or kind.dtype.kind not in "biuf":
        raise Refused(f"attribute {name} is not a single text or number")
    cell = np.empty((), kind.dtype)
    attribute.read(cell)
    number: int | float | bool = cell.item()
    return number if math.isfinite(number) else str(number)


def _placement(dataset: h5d.DatasetID, size: int, values: list[int], tail: list[bytes]) -> dict[str, Any]:
    """Return type, shape and layout of an array, and append its chunk table or its value to `tail`."""
    if dataset.get_space().get_simple_extent_type() == h5s.NULL:
        raise Refused("has no shape")
    plan, shape, dtype = dataset.get_create_plist(), tuple(map(int, dataset.shape)), _dtype(dataset.get_type())
    facts = {"dtype": dtype.str, "shape": shape}
    nbytes = dtype.itemsize * math.prod(shape)
    layout = plan.get_layout()
    if layout == h5d.CONTIGUOUS and nbytes and dataset.get_offset() is None:
        raise Refused("was declared but never written")
    if layout == h5d.CONTIGUOUS and nbytes and shape:
        if nbytes > size:
            raise Refused(f"claims {nbytes} bytes, more than the file has")
        rows = min(shape[0], max(1, SLICE // (nbytes // shape[0])))
        starts = np.arange(0, nbytes, rows * (nbytes // shape[0]))
        sizes = np.diff(np.append(starts, nbytes))
        table = np.stack([dataset.get_offset() + starts, sizes, np.zeros_like(starts)], axis=1)
    elif layout == h5d.CHUNKED and nbytes and plan.get_chunk()[1:] == shape[1:]:
        rows, table = plan.get_chunk()[0], _chunks(dataset, plan, size)
    else:
        values[0] -= nbytes
        if values[0] < 0:
            raise Refused(f"is not stored in whole rows, and larger than the {VALUES} bytes that such arrays may have")
        if layout == h5d.CHUNKED and nbytes:
            _chunks(dataset, plan, size)
        value = np.empty(shape, dtype)
        if nbytes:
            dataset.read(h5s.ALL, h5s.ALL, value)
        tail.append(value.tobytes())
        return {**facts, "value": nbytes, "in_pieces": layout == h5d.CHUNKED and bool(nbytes)}
    tail.append(table.astype(np.int64).tobytes())
    return {**facts, "chunk_rows": int(rows), "chunks": len(table)}


def _dtype(kind: h5t.TypeID) -> np.dtype:
    """Return the NumPy dtype with the same bytes as an HDF5 type; refuse types that have none."""
    if kind.committed():
        raise Refused("has a named type")
    try:
        dtype = kind.dtype
        same = dtype.kind in "biufcS" and kind.equal(h5t.py_create(dtype, logical=True))
    except (TypeError, ValueError):
        same = False
    if not same:
        raise Refused("is of a type other than numbers, booleans and texts of fixed length")
    return dtype


def _chunks(dataset: h5d.DatasetID, plan: h5p.PropDCID, size: int) -> np.ndarray:
    """Return offset [bytes], size [bytes] and filter bits of each chunk, in order; shape (K, 3), int64."""
    lengths = plan.get_chunk()
    codes = [plan.get_filter(position)[0] for position in range(plan.get_nfilters())]
    if codes != [code for code, _ in FILTERS if code in codes]:
        raise Refused(f"is stored with filters {codes}; possible are shuffle, gzip, fletcher32, in this order")
    per_axis = [-(-length // chunk) for length, chunk in zip(dataset.shape, lengths, strict=True)]
    count = math.prod(per_axis)
    if count > size // BYTES_PER_CHUNK:
        raise Refused(f"claims {count} chunks, more than the file has room for")
    found = array("q")

    def note(chunk: h5d.StoreInfo) -> bool | None:
        number = 0
        for start, length, along in zip(chunk.chunk_offset, lengths, per_axis, strict=True):
            number = number * along + start // length
        found.extend((number, chunk.byte_offset or -1, chunk.size, chunk.filter_mask))
        return True if len(found) > 4 * count else None  # anything but None stops

    if dataset.chunk_iter(note):
        raise Refused("has more chunks than its shape")
    numbers, *columns = np.array(found, np.int64).reshape(-1, 4).T
    if not np.array_equal(np.sort(numbers), np.arange(count)):
        raise Refused("has chunks that were never written")
    table = np.empty((count, 3), np.int64)
    table[numbers] = np.stack(columns, axis=1)
    bits = [bit for code, bit in FILTERS if code in codes]
    table[:, 2] = sum((bit * (table[:, 2] >> position & 1 == 0) for position, bit in enumerate(bits)), np.int64(0))
    return table


def main() -> None:
    """Answer questions until the process that asks them is gone."""
    asked = socket.socket(fileno=0)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _warm_up()
    gc.disable()  # a process that answers only one question does not need it
    base = _address_space()
    asked.sendall(b"\n")  # tells that the program is ready
    question = b""
    descriptors: list[int] = []
    while True:
        piece, received, _, _ = socket.recv_fds(asked, 2**16, 2)
        if not piece:
            return
        question, descriptors = question + piece, descriptors + received
        if not question.endswith(b"\n"):
            continue
        child = os.fork()
        if child == 0:
            _answer(json.loads(question), descriptors[0], descriptors[1], base)
        for descriptor in descriptors:
            os.close(descriptor)
        question, descriptors = b"", []
        asked.sendall(struct.pack("i", os.waitpid(child, 0)[1]))


def _warm_up() -> None:
    """Use h5py once, so that it loads all that it needs: the forked processes cannot open files any more."""
    example = io.BytesIO()
    with h5py.File(example, "w") as file:
        file["numbers"], file["text"], file["words"] = np.zeros(3), np.bytes_(b"text"), ["some", "words"]
        file.create_dataset("chunks", data=np.zeros(3), chunks=(3,), compression="gzip", shuffle=True, fletcher32=True)
        file.attrs.update({"text": "text", "ascii": np.bytes_(b"text"), "number": 1, "yes": True})
    examine(example, ["text", "ascii", "number", "yes", "none"], ["text"])


def _answer(question: dict[str, Any], file: int, pipe: int, base: int) -> None:
    """Answer one question in a forked process, and end this process."""
    try:
        os.dup2(1, 0)  # this process may not use the socket to the asking process
        _confine(base + MEMORY + question["size"] if base else 0)
        content = Content(file, question["offset"], question["size"])
        lines: Callable[..., Any] = damaged if "expected" in question else examine
        arguments = {key: question[key] for key in ("expected", "names", "meaning") if key in question}
        for piece in lines(content, **arguments):
            view = memoryview(piece)
            while view:
                view = view[os.write(pipe, view) :]
        os._exit(0)
    finally:
        os._exit(1)


def _confine(address_space: int) -> None:
    """Restrict this process: it may open no files, start no processes, and use limited memory and time."""
    signal.alarm(SECONDS)  # ends the process even inside a loop of a library
    limits = {"NOFILE": 0, "FSIZE": 0, "CORE": 0, "NPROC": 0, "CPU": CPU_SECONDS}
    if address_space:
        limits["AS"] = address_space
    for name, limit in limits.items():
        kind = getattr(resource, f"RLIMIT_{name}", None)
        if kind is not None:
            resource.setrlimit(kind, (limit, limit))


def _address_space() -> int:
    """Return the size of the address space of this process, [bytes]; 0 if the system does not tell it."""
    try:
        with open("/proc/self/statm") as file:
            return int(file.read().split()[0]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return 0


if __name__ == "__main__":
    main()
