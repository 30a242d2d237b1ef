"""Descriptions of episode files in the user's private cache, so that unchanged files need not be examined again.

Each episode has one small cache file (so no lock can be left behind or time out on a network disk). The name of the
cache file is a hash of everything that distinguishes the episode file from all others: device, inode, size, times of
change, and place in a shard. Only valid episodes are kept, and only for the version of the code that checked them. A
file in the dataset's folder could have been written by anybody; only the user can write to the cache folder. If
anything goes wrong in this module, the episode is opened as if for the first time.
"""

import hashlib
import os
import time
from contextlib import suppress
from pathlib import Path

from svfl_data.storage.chunks import Extent
from svfl_data.system.cache_folder import cache_folder, source_hash

PURPOSE = "headers"
RULES = ("schema", "storage", "symmetry.py")
"""Files and folders of this package whose code decides whether an episode is valid."""
ENTRY, ENTRIES, BYTES = 2**22, 20_000, 2**28
"""Largest size of one cache entry [bytes], largest number of entries, and largest size of all entries [bytes].

The oldest entries are deleted beyond that."""
SETTLED_NS = 2_000_000_000
"""Age below which a file is not cached, [ns]. A file that changed within the last two seconds may change again without
a visible difference in its times."""
DIGEST = hashlib.sha256().digest_size
STORED_BETWEEN_SWEEPS = 500

_stored = 0


def recall(extent: Extent) -> tuple[str, bytes] | None:
    """Return the seal and the description of an episode from the cache.

    Args:
        extent: Place of the episode.

    Returns:
        SHA-256 of the episode's content, in hexadecimal, and the answer of the examiner; None if the cache has no
        intact entry of this episode.
    """
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
        return None  # only partly written, or damaged
    return rest[:DIGEST].hex(), rest[DIGEST:]


def remember(extent: Extent, seal: str, description: bytes) -> None:
    """Put a valid episode into the cache, unless its file is so new that a change could go unnoticed.

    Args:
        extent: Place of the episode.
        seal: SHA-256 of the episode's content, in hexadecimal.
        description: Answer of the examiner (`svfl_data.storage.examination.ask`).
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
        # Neither a rename nor a sync is needed: an entry that is only partly written does not match its hash.
        place.write_bytes(hashlib.sha256(rest).digest() + rest)


def _place(extent: Extent) -> Path | None:
    folder = cache_folder(PURPOSE)
    if folder is None or not extent.identity[1]:
        return None
    parts = (source_hash(*RULES), *extent.identity, extent.file_size, extent.mtime_ns, extent.offset, extent.size)
    return folder / hashlib.sha256(repr(parts).encode()).hexdigest()[:40]


def _sweep(folder: Path) -> None:
    """Delete the oldest entries beyond the `ENTRIES` and `BYTES` that may be kept."""
    with os.scandir(folder) as listing:
        found = sorted(((entry.stat(), entry.path) for entry in listing), key=lambda one: -one[0].st_mtime_ns)
    total = 0
    for number, (facts, path) in enumerate(found):
        total += facts.st_size
        if number >= ENTRIES or total > BYTES:
            os.unlink(path)
