"""What was learned of episode files, kept in the user's private cache, so that unchanged ones are not opened again.

Each episode is a small file of its own (no lock can be left behind or time out on a network disk), named by a hash of
what tells its file from all others: device, inode, size, times of change, place in a shard. Only valid episodes are
kept, and only for the very code that judged them. A file in the dataset's folder could be anybody's; this folder is
the user's alone. Whatever goes wrong here means that an episode is opened as if for the first time.
"""

import hashlib
import os
import time
from contextlib import suppress
from pathlib import Path

from svfl_data.storage.chunks import Extent
from svfl_data.system.cache_folder import cache_folder, source_hash

PURPOSE = "headers"
JUDGES = ("schema", "storage", "symmetry.py")
"""Files and folders of this package on which it depends whether an episode is valid."""
ENTRY, ENTRIES, BYTES = 2**22, 20_000, 2**28
"""Most bytes of an entry, and most entries and bytes of all: the oldest are dropped beyond that."""
SETTLED_NS = 2_000_000_000
"""A file that changed within the last two seconds may change again without its times telling."""
DIGEST = hashlib.sha256().digest_size
STORED_BETWEEN_SWEEPS = 500

_stored = 0


def recall(extent: Extent) -> tuple[str, bytes] | None:
    """Seal and description of an episode, as they were remembered; None if they were not."""
    place = _place(extent)
    if place is None:
        return None
    try:
        with open(place, "rb") as file:
            content = file.read(ENTRY + 1)
    except OSError:
        return None
    mark, rest = content[:DIGEST], content[DIGEST:]
    if len(content) > ENTRY or len(rest) < DIGEST or hashlib.sha256(rest).digest() != mark:
        return None  # written by halves, or damaged
    return rest[:DIGEST].hex(), rest[DIGEST:]


def remember(extent: Extent, seal: str, description: bytes) -> None:
    """Remember a valid episode, if its file is unlikely to change unnoticed.

    Args:
        extent: The episode.
        seal: SHA-256 of its content, in hexadecimal.
        description: The examiner's answer.
    """
    global _stored
    age_ns = time.time_ns() - max(extent.mtime_ns, extent.identity[2])
    place = _place(extent)
    if place is None or age_ns < SETTLED_NS or len(description) > ENTRY - 2 * DIGEST:
        return
    rest = bytes.fromhex(seal) + description
    with suppress(OSError):
        if _stored % STORED_BETWEEN_SWEEPS == 0:
            _sweep(place.parent)
        _stored += 1
        # No rename and no sync: what is found written by halves does not match its hash.
        place.write_bytes(hashlib.sha256(rest).digest() + rest)


def _place(extent: Extent) -> Path | None:
    folder = cache_folder(PURPOSE)
    if folder is None or not extent.identity[1]:
        return None
    parts = (source_hash(*JUDGES), *extent.identity, extent.file_size, extent.mtime_ns, extent.offset, extent.size)
    return folder / hashlib.sha256(repr(parts).encode()).hexdigest()[:40]


def _sweep(folder: Path) -> None:
    """Drop the oldest entries beyond what may be kept."""
    with os.scandir(folder) as listing:
        found = sorted(((entry.stat(), entry.path) for entry in listing), key=lambda one: -one[0].st_mtime_ns)
    total = 0
    for number, (facts, path) in enumerate(found):
        total += facts.st_size
        if number >= ENTRIES or total > BYTES:
            os.unlink(path)
