"""Finding the same recording twice: with a copy of a training episode among them, test episodes test nothing.

Copies are told by what was recorded, not by names or metadata: a relabelled, merged or renumbered copy is one, too.
"""

import hashlib
from collections.abc import Iterable, Sequence
from typing import TypeVar

import numpy as np

from svfl_data.schema.fields import field_at
from svfl_data.storage.reader import EpisodeReader

Named = TypeVar("Named")


def content_id(reader: EpisodeReader) -> str:
    """Hash of what was recorded: all declared arrays, of images the first and the last one.

    Args:
        reader: The episode.

    Returns:
        32 hexadecimal digits; equal for equal recordings whatever is said about them.

    Raises:
        FormatError: If the episode cannot be read.
    """
    digest = hashlib.sha256()
    for path in sorted(reader.paths):
        field, array = field_at(path), reader[path]
        if field is None or path.startswith("labels/"):
            continue
        digest.update(f"{path} {array.dtype} {array.shape}\n".encode())
        parts = [array[0], array[len(array) - 1]] if field.image and len(array) else [array[()]]
        for part in parts:
            digest.update(np.ascontiguousarray(part).tobytes())
    return digest.hexdigest()[:32]


def copies(episodes: Iterable[tuple[Named, str]]) -> list[tuple[Named, Named]]:
    """Which episodes are copies of an earlier one.

    Args:
        episodes: Each with its `content_id`.

    Returns:
        The copy and the first of its kind, in order.
    """
    first: dict[str, Named] = {}
    found = []
    for name, content in episodes:
        if content in first:
            found.append((name, first[content]))
        first.setdefault(content, name)
    return found


def copies_words(found: Sequence[tuple[object, object]], most: int = 3) -> str:
    """Copies in words, the first few by name."""
    named = ", ".join(f"{copy} of {first}" for copy, first in found[:most])
    more = f" and {len(found) - most} more" if len(found) > most else ""
    return f"{named}{more}"
