"""What one start of a program was: its code, machine, data and command, in plain values."""

import hashlib
import os
import platform
import re
import shlex
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Annotated, Any

import msgspec

from svfl_data.datasets.dataset import Dataset
from svfl_data.datasets.fingerprint import identity
from svfl_data.errors import SvflError
from svfl_data.system.printable import printable
from svfl_models.training.provenance.commit import own_commit

PROGRAMS = ("svfl-train", "svfl-collect", "svfl-data")
FROM_PYTHON = "called from Python"
LIBRARIES = (
    "svfl", "torch", "lightning", "escnn", "numpy", "scipy", "h5py", "msgspec", "joblib", "pybullet", "numba",
    "gymnasium", "opencv-python-headless",
)  # fmt: skip
"""Packages on which the numbers of a run depend; those that are installed are listed."""
CREDENTIALS = re.compile(r"(\w+://)[^/@\s]+@")
SECRET_OPTION = re.compile(r"--[\w-]*(token|secret|passw|credential|api-?key)[\w-]*", re.IGNORECASE)
LONGEST, LONGEST_COMMAND, MOST = 4096, 16384, 1000
"""Most characters of a text and of a command line, and most entries of a list, that are kept and read."""

Text = Annotated[str, msgspec.Meta(max_length=LONGEST)]
Count = Annotated[int, msgspec.Meta(ge=0, le=2**63 - 1)]


@dataclass(frozen=True)
class Host:
    """Machine on which a program ran.

    Attributes:
        name: Name in the network.
        processor: Model of the processor.
        cores: Number of processor cores that the program could use.
        system: Operating system with its version.
    """

    name: Text = ""
    processor: Text = ""
    cores: Count = 0
    system: Text = ""


@dataclass(frozen=True)
class DataRecord:
    """A dataset or a file that a program has read.

    Attributes:
        path: Path as the user gave it.
        sha256: Of a dataset its identity (`svfl_data.datasets.fingerprint.identity`), of a file the SHA-256 of its
            content; empty if it could not be read.
        episodes: Number of episodes of a dataset; None for a file.
        unsealed: Number of episodes that the identity does not cover.
    """

    path: Text
    sha256: Annotated[str, msgspec.Meta(max_length=64)] = ""
    episodes: Count | None = None
    unsealed: Count = 0


@dataclass(frozen=True)
class Session:
    """One start of a program that trains, evaluates or reports.

    Attributes:
        started: Time of the start, UTC, as in ISO 8601.
        command: Command line, in which secrets are replaced by ``***``; `FROM_PYTHON` if there was none.
        commit: Hash of the git commit of the source; empty if it is no checkout; then only the version of ``svfl`` is
            known.
        clean: Whether the source is that of the commit; None if there is no commit, or git does not tell.
        packages: Versions of Python and of the installed `LIBRARIES`, by name.
        host: Machine.
        device: Name of the processor or GPU that computed; empty if the program only gathered results.
        seeds: Seeds of everything random.
        data: Datasets and files that were read, by the option that names them.
    """

    started: Text
    command: Annotated[str, msgspec.Meta(max_length=LONGEST_COMMAND)] = FROM_PYTHON
    commit: Annotated[str, msgspec.Meta(max_length=64)] = ""
    clean: bool | None = None
    packages: Annotated[dict[Text, Text], msgspec.Meta(max_length=MOST)] = field(default_factory=dict)
    host: Host = field(default_factory=Host)
    device: Text = ""
    seeds: Annotated[tuple[int, ...], msgspec.Meta(max_length=MOST)] = ()
    data: Annotated[dict[Text, DataRecord], msgspec.Meta(max_length=MOST)] = field(default_factory=dict)

    def plain(self) -> dict[str, Any]:
        """Return the attributes as a dictionary of plain values for files."""
        return asdict(self)


def session(data: Mapping[str, DataRecord], seeds: Sequence[int] = (), device: str | None = None) -> Session:
    """Return the provenance of what this process does now. It never fails: what cannot be found out is left empty.

    Args:
        data: Datasets and files that are read, by the option that names them, from `dataset` and `file`.
        seeds: Seeds of everything random.
        device: Name of the GPU that computes; None for the processor; empty for a program that only gathers results.
    """
    found, machine = own_commit(), host()
    return Session(
        started=datetime.now(UTC).isoformat(timespec="seconds"),
        command=command_line(sys.argv),
        commit=found.sha if found else "",
        clean=found.clean if found else None,
        packages=packages(),
        host=machine,
        device=machine.processor if device is None else device,
        seeds=tuple(seeds)[:MOST],
        data=dict(data),
    )


def dataset(path: Path | str) -> DataRecord:
    """Return the identity of a dataset that a program reads.

    Args:
        path: Folder of the dataset, as the user gave it.
    """
    try:
        found = identity(Dataset.open(path))
    except SvflError:
        return DataRecord(_path(path))
    return DataRecord(_path(path), found.sha256, found.episodes, found.unsealed)


def file(path: Path | str) -> DataRecord:
    """Return the SHA-256 of a file that a program reads.

    Args:
        path: Path of an ordinary file, such as a checkpoint, as the user gave it.
    """
    try:
        with Path(path).open("rb") as opened:
            return DataRecord(_path(path), hashlib.file_digest(opened, "sha256").hexdigest())
    except OSError:
        return DataRecord(_path(path))


def host() -> Host:
    """Return what is known of this machine."""
    return Host(platform.node(), _processor(), len(os.sched_getaffinity(0)), platform.platform())


def packages() -> dict[str, str]:
    """Return the versions of Python and of the installed `LIBRARIES`, which are not imported for that."""
    found = {"python": platform.python_version()}
    for name in LIBRARIES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def command_line(words: Sequence[str]) -> str:
    """Return a command line as it can be shown to anybody, or `FROM_PYTHON` if it is not one of this software.

    Credentials in addresses, and the values of options that are called a token, secret, password or key, are replaced.

    Args:
        words: Path of the program and its arguments, as in `sys.argv`.
    """
    program = Path(words[0]).stem if words else ""
    if program not in PROGRAMS:
        return FROM_PYTHON
    shown, hides = [program], False
    for word in words[1:]:
        option, equals, _ = word.partition("=")
        if hides and not word.startswith("--"):
            word = "***"
        elif equals and SECRET_OPTION.fullmatch(option):
            word = f"{option}=***"
        hides = not equals and bool(SECRET_OPTION.fullmatch(word))
        shown.append(CREDENTIALS.sub(r"\1***@", word))
    return printable(shlex.join(shown), LONGEST_COMMAND)[:LONGEST_COMMAND]


def _path(path: Path | str) -> str:
    return printable(CREDENTIALS.sub(r"\1***@", str(path)), LONGEST)[:LONGEST]


def _processor() -> str:
    try:
        with open("/proc/cpuinfo", encoding="utf-8", errors="replace") as lines:
            named = next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), "")
    except OSError:
        named = ""
    return printable(named or platform.machine(), 100)
