"""What a kind of hostile file is, and the folder that it is made in.

A kind is a function that is given the folder of a sound dataset and spoils it. Around that folder, which is called
``data``, stands what a stranger would like to reach::

    box/data       the dataset
    box/outside    a secret, a folder, a named pipe; nothing may be read from or written to them
    box/PAYLOAD    does not exist, and must not: what code that was smuggled in would make
"""

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from svfl_data.storage.seal import SEAL_SIZE, seal

SECRET = b"svfl-secret-of-the-user\n" + b"q" * 2**16
"""Begins with words and goes on with one byte, which is found again whatever has shuffled or cut it."""
TRACES = (b"svfl-secret-of-the-user", b"q" * 48, b"root:x:0:0:")
"""What is left of the secret, or of the password file, where somebody has copied it."""


@dataclass(frozen=True)
class Kind:
    """A way to spoil a dataset.

    Attributes:
        name: Theme and name.
        concern: What is spoilt, so that commands that never read it may succeed: ``episode`` (the first one's bytes),
            ``shard``, ``folder`` (its entries), ``info`` (dataset.json), ``index``, ``split``, ``statistics``,
            ``journal``, ``order`` (of time stamps: such an episode can be looked at), ``config`` (of a simulated
            episode), ``urdf``, or the name of a model's file.
        make: Does it.
        legal: Why a command may nevertheless accept it; empty if it must not.
        slow: Whether making it takes seconds.
    """

    name: str
    concern: str
    make: Callable[[Path], None]
    legal: str = ""
    slow: bool = False


KINDS: list[Kind] = []


def hostile(concern: str, legal: str = "", slow: bool = False) -> Callable:
    """Register a function as a kind, named after its module and itself."""

    def register(make: Callable[[Path], None]) -> Callable[[Path], None]:
        add(make.__module__.rpartition(".")[2].removeprefix("making_"), make.__name__, concern, make, legal, slow)
        return make

    return register


def add(theme: str, name: str, concern: str, make: Callable[[Path], None], legal: str = "", slow: bool = False) -> None:
    """Register a kind."""
    kind = Kind(f"{theme}/{name}", concern, make, legal, slow)
    assert kind.name not in {other.name for other in KINDS}, kind.name
    KINDS.append(kind)


def outside(folder: Path, name: str = "secret") -> Path:
    """Something beside the dataset: ``secret``, ``pipe``, ``folder``, ``lines`` (a file of the user's to append to)."""
    return folder.parent / "outside" / name


def payload(folder: Path) -> Path:
    """The file that smuggled code makes."""
    return folder.parent / "PAYLOAD"


def build_outside(box: Path) -> None:
    """Make what stands around the dataset."""
    place = box / "outside"
    (place / "folder").mkdir(parents=True)
    (place / "folder" / "inner").write_bytes(SECRET)
    (place / "secret").write_bytes(SECRET)
    (place / "lines").write_bytes(SECRET)
    os.mkfifo(place / "pipe")


def episode_file(folder: Path, index: int = 0) -> Path:
    """The file of an episode."""
    return folder / f"episode_{index:06d}.hdf5"


def content_of(path: Path) -> bytes:
    """What was sealed."""
    return path.read_bytes()[:-SEAL_SIZE]


def write_resealed(path: Path, content: bytes) -> None:
    """Seal something, as anybody can."""
    path.write_bytes(content + seal(content))
