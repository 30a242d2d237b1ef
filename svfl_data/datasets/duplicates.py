"""Detection of recordings that occur twice, because copies of training episodes must not be test episodes.

Copies are recognised by what was recorded, not by names or metadata. So a relabelled, merged or renumbered episode is a
copy, too.
"""

import hashlib
from collections.abc import Iterable, Sequence
from typing import TypeVar

import numpy as np

from svfl_data.storage.reader import EpisodeReader

Named = TypeVar("Named")


def content_id(reader: EpisodeReader) -> str:
    """Return a hash of what was recorded in an episode.

    The hash covers all declared arrays except labels; of images and other large rows, it covers the first and the last
    one.

    Args:
        reader: Reader of the episode.

    Returns:
        The hash as 32 hexadecimal digits. It is equal for equal recordings, whatever their metadata and labels say.

    Raises:
        FormatError: If the episode cannot be read.
    """
    digest = hashlib.sha256()
    for path in sorted(reader.paths):
        field, array = reader.declarations.at(path), reader[path]
        if field is None or path.startswith("labels/"):
            continue
        digest.update(f"{path} {array.dtype} {array.shape}\n".encode())
        parts = [array[0], array[len(array) - 1]] if field.large and len(array) else [array[()]]
        for part in parts:
            digest.update(np.ascontiguousarray(part).tobytes())
    return digest.hexdigest()[:32]


def copies(episodes: Iterable[tuple[Named, str]]) -> list[tuple[Named, Named]]:
    """Return the episodes that are copies of an earlier one.

    Args:
        episodes: Name and `content_id` of each episode, in order.

    Returns:
        Names of each copy and of the first episode with the same content, in order.
    """
    first: dict[str, Named] = {}
    found = []
    for name, content in episodes:
        if content in first:
            found.append((name, first[content]))
        first.setdefault(content, name)
    return found


def copies_words(found: Sequence[tuple[object, object]], most: int = 3) -> str:
    """Return copies in words, of which the first few are named.

    Args:
        found: Result of `copies`.
        most: Largest number of copies that are named.
    """
    named = ", ".join(f"{copy} of {first}" for copy, first in found[:most])
    more = f" and {len(found) - most} more" if len(found) > most else ""
    return f"{named}{more}"
