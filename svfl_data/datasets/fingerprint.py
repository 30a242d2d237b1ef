"""The fingerprint of some episodes of a dataset, by which it is known whether results belong to them."""

import hashlib
from collections.abc import Iterable

from svfl_data.datasets.dataset import Dataset


def fingerprint(dataset: Dataset, episodes: Iterable[int]) -> str:
    """Return the SHA-256 of the indices and seals of episodes, in hexadecimal.

    Args:
        dataset: Dataset to read the seals from.
        episodes: Indices of the episodes. Their order changes the hash.
    """
    digest = hashlib.sha256()
    for index in episodes:
        digest.update(f"{index}:{dataset.episode(index).written_seal}\n".encode())
    return digest.hexdigest()
