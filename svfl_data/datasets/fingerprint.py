"""Hashes over the seals of episodes, by which it is known which data results belong to."""

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass

from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import DatasetError, FormatError

NO_SEAL = "-"
"""What `identity` hashes in the place of the seal of an episode that has none."""


@dataclass(frozen=True)
class Identity:
    """What distinguishes the content of a dataset from any other content.

    Attributes:
        sha256: SHA-256 of the indices and seals of all episodes, in the order of the indices, in hexadecimal.
        episodes: Number of episodes.
        unsealed: Number of episodes among them whose content the hash does not cover, because they have no seal or
            cannot be read.
    """

    sha256: str
    episodes: int
    unsealed: int = 0

    def __str__(self) -> str:
        unsealed = f", {self.unsealed} of them without a seal, whose content it does not cover" if self.unsealed else ""
        return f"{self.sha256} ({self.episodes} episodes{unsealed})"


def identity(dataset: Dataset) -> Identity:
    """Return the identity of a dataset, for which only the seal of each episode is read.

    It depends on the indices and the contents of the episodes, not on where they lie: a packed dataset, a copy of it
    and the unpacked one have the same identity. Everything that gives an episode another seal changes it (a new label,
    another text of metadata), and so does adding, removing or renumbering an episode. It does not depend on
    ``dataset.json``, splits and other files beside the episodes.

    The seals are taken as they stand in the files; whoever reads an episode compares its content with its seal.

    Args:
        dataset: The dataset.

    Raises:
        FormatError: If a shard is damaged, so that the episodes are not known.
        StorageError: If the folder cannot be read.
    """
    seals: dict[int, str] = {}
    for index in dataset.indices:
        try:
            seals[index] = dataset.episode(index).written_seal
        except (FormatError, DatasetError):  # also one that was removed since it was listed
            seals[index] = NO_SEAL
    return Identity(_hash(seals.items()), len(seals), list(seals.values()).count(NO_SEAL))


def fingerprint(dataset: Dataset, episodes: Iterable[int]) -> str:
    """Return the SHA-256 of the indices and seals of some episodes, in hexadecimal.

    For all episodes of a dataset, in the order of their indices, it is the `Identity.sha256` of the dataset.

    Args:
        dataset: Dataset to read the seals from.
        episodes: Indices of the episodes. Their order changes the hash.

    Raises:
        FormatError: If an episode has no seal or cannot be read.
    """
    return _hash((index, dataset.episode(index).written_seal) for index in episodes)


def _hash(seals: Iterable[tuple[int, str]]) -> str:
    digest = hashlib.sha256()
    for index, seal in seals:
        digest.update(f"{index}:{seal}\n".encode())
    return digest.hexdigest()
