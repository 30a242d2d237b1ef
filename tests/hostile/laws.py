"""How a command may end on a hostile file, and what may stand in what it prints and writes."""

import re
import unicodedata
import zlib
from collections.abc import Iterator
from dataclasses import dataclass

from tests.hostile.commands import Command
from tests.hostile.kind import TRACES, Kind

LINE_CHARACTERS = 4000
NOTICE = re.compile(r"episodes have warnings, which svfl-data validate names")
"""What is said beside a complaint, or where there is none."""
OUT_OF_MEMORY = re.compile(rb"unable to allocate|MemoryError|Cannot allocate memory|std::bad_alloc", re.IGNORECASE)


@dataclass(frozen=True)
class Ended:
    """How a command ended.

    Attributes:
        code: Its exit code; negative for a signal.
        hung: Whether it had to be killed.
        cpu_s: Processor time of it and its children, [s].
        peak_bytes: Most memory of it or one of its children.
        out: Its standard output.
        err: Its standard error.
    """

    code: int
    hung: bool
    cpu_s: float
    peak_bytes: int
    out: bytes
    err: bytes


def endings(ended: Ended, command: Command, kind: Kind) -> Iterator[str]:
    """What is wrong with how a command ended, in words."""
    if ended.hung:
        yield "hangs"
    elif ended.code < 0:
        yield f"killed by signal {-ended.code}"
    elif ended.code == 0 and not command.may_succeed(kind):
        yield "accepted"
    elif ended.code and ended.code not in command.codes:
        yield f"exit code {ended.code}"
    if b"Traceback (most recent call last)" in ended.err + ended.out:
        yield f"traceback: {_last_line(ended.err)}"
    elif OUT_OF_MEMORY.search(ended.err + ended.out):
        yield f"asked for more memory than there is: {_last_line(ended.err)}"
    elif not ended.hung and ended.code >= 0:
        lines = [line for line in ended.err.decode(errors="replace").splitlines() if not NOTICE.search(line)]
        if len(lines) != (ended.code != 0):
            yield f"{len(lines)} lines of complaint with exit code {ended.code}: {lines[:3]}"[:400]
        elif lines and len(lines[0]) > LINE_CHARACTERS:
            yield f"a line of {len(lines[0])} characters"


def outputs(ended: Ended, command: Command) -> Iterator[str]:
    """What is wrong with what it printed."""
    for name, text in (("output", ended.out), ("complaint", ended.err)):
        if trace := next((trace for trace in (*TRACES, b"q" * 16) if trace in text), None):
            yield f"leak: the {name} shows {trace!r}"
        if name == "output" and command.binary:
            continue
        if hidden := hidden_characters(text):
            yield f"hidden characters in the {name}: {hidden}"


def hidden_characters(text: bytes) -> str:
    """Characters that a terminal or an editor would obey instead of show."""
    try:
        decoded = text.decode()
    except UnicodeDecodeError as error:
        return str(error)[:100]
    found = {c for c in set(decoded) if unicodedata.category(c) in ("Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp")}
    return " ".join(sorted(f"U+{ord(c):04X}" for c in found - {"\n", "\t"}))


def leaked(content: bytes) -> bytes | None:
    """A trace of the secret, as it is or in anything that zlib has packed (HDF5, PNG)."""
    if trace := next((trace for trace in TRACES if trace in content), None):
        return trace
    for found in re.finditer(rb"\x78[\x01\x5e\x9c\xda]", content):
        try:
            unpacked = zlib.decompressobj().decompress(content[found.start() : found.start() + 2**16], 2**16)
        except zlib.error:
            continue
        if trace := next((trace for trace in TRACES if trace in unpacked), None):
            return trace
    return None


def _last_line(text: bytes) -> str:
    lines = text.decode(errors="replace").strip().splitlines()
    raised = [line for line in lines if re.match(r"[\w.]+(Error|Exception|Interrupt|Exit)\b", line)]
    return (raised or lines or [""])[-1][:200]
