"""Reproducible splits: of the episodes of a dataset, stored with the dataset, or of samples, for one experiment.

Steps of one episode are nearly copies of each other. A dataset is therefore only split by whole episodes, and the split
is stored beside the episodes, so that everyone trains and tests on the same episodes.
"""

import hashlib
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from svfl_data.datasets.dataset import SPLITS as FOLDER
from svfl_data.datasets.dataset import Dataset, inner_folder
from svfl_data.datasets.duplicates import copies, copies_words
from svfl_data.datasets.index import entries
from svfl_data.errors import DatasetError, FormatError, StorageError, UsageError
from svfl_data.schema.episode import canonical_json
from svfl_data.system.atomic_io import write_atomically
from svfl_data.system.regular_file import refuse_link
from svfl_data.system.side_files import Count, Int64, check_format, parse_as, read_side_file

FORMAT = "svfl-split"
FORMAT_VERSION = "1.0"
NAME = re.compile(r"[\w-]{1,100}")
MOST_NAMED = 5
"""Largest number of missing episodes or stored splits that an error message names."""


class SplitFile(msgspec.Struct):
    """Fields that the file of a split must contain besides its format and version."""

    sha256: str
    seed: Int64
    rule: dict[str, Any]
    parts: dict[str, list[Count]]


@dataclass(frozen=True)
class Split:
    """Division of the episodes of a dataset into parts, such as training and test episodes.

    Attributes:
        name: Name of the split and of its file.
        seed: Seed with which the split was drawn.
        rule: Description of how the split was drawn: the requested shares, and the number of episodes.
        parts: Indices of the episodes of each part, ascending. No episode is in two parts.

    Example:
        >>> split = split_episodes(range(10), {"train": 0.8, "test": 0.2}, seed=0)
        >>> len(split["train"]), len(split["test"])
        (8, 2)
    """

    name: str
    seed: int
    rule: dict[str, Any]
    parts: dict[str, list[int]]

    def __getitem__(self, part: str) -> list[int]:
        if part not in self.parts:
            raise DatasetError(f"split {self.name!r} has no part {part!r}; it has {', '.join(self.parts)}")
        return self.parts[part]

    @property
    def sha256(self) -> str:
        """SHA-256 of the parts and their episodes, in hexadecimal, independent of the split's name, seed and rule."""
        return hashlib.sha256(canonical_json(self.parts).encode()).hexdigest()

    def save(self, dataset: Dataset, replace: bool = False) -> Path:
        """Store the split beside the episodes of a dataset.

        Args:
            dataset: Dataset to store the split in.
            replace: Whether to replace another split of the same name.

        Returns:
            The file that was written.

        Raises:
            DatasetError: If another split of the same name is stored already and `replace` is false, because
                experiments may depend on the stored split.
            FormatError: If the file or its folder is a link.
            StorageError: If the file cannot be written.
        """
        file = split_file(dataset, self.name)
        inner_folder(dataset.path, FOLDER)
        refuse_link(file)
        content = {"format": FORMAT, "format_version": FORMAT_VERSION, "sha256": self.sha256, **asdict(self)}
        try:
            write_atomically(file, (canonical_json(content) + "\n").encode(), replace)
        except StorageError:
            if replace or not file.exists():
                raise  # otherwise a split of this name is stored already, perhaps by another process just now
            if load_split(dataset, self.name).sha256 != self.sha256:
                raise DatasetError(
                    f"{file} holds another split; choose another name, or replace it (svfl-data split --replace) if "
                    "nothing that was trained on it shall be tested on it"
                ) from None
        return file


def split_file(dataset: Dataset, name: str) -> Path:
    """Return the file of a split, whether or not the file exists.

    Args:
        dataset: Dataset that the split belongs to.
        name: Name of the split: 1 to 100 letters, digits, - and _.

    Raises:
        UsageError: If the name has other characters or another length.
    """
    if not NAME.fullmatch(name):
        raise UsageError(f"{name!r} cannot be the name of a split: use letters, digits, - and _")
    return dataset.path / FOLDER / f"{name}.json"


def split_episodes(indices: Sequence[int], shares: Mapping[str, float], seed: int, name: str = "default") -> Split:
    """Draw a split of episodes at random.

    Args:
        indices: Indices of the episodes, in any order.
        shares: Share of the episodes of each part by its name, such as ``{"train": 0.8, "valid": 0.1, "test": 0.1}``.
            The shares are positive and sum to at most 1. Each part gets its share rounded down. The episodes left over
            go, one each, to the parts that lost most by rounding.
        seed: Seed of the draw. The same seed, episodes and shares give the same split.
        name: Name of the split.

    Raises:
        UsageError: If a share is not positive, or the shares sum to more than 1.
        DatasetError: If there are too few episodes to give one to each part.

    Example:
        >>> split_episodes(range(10), {"train": 0.8, "valid": 0.1, "test": 0.1}, seed=0)["valid"]
        [...]
    """
    total = sum(shares.values())
    if not shares or min(shares.values()) <= 0 or total > 1 + 1e-9:
        raise UsageError(f"shares must be positive and sum to at most 1, asked for {dict(shares)}")
    exact = np.array(list(shares.values())) * len(indices)
    sizes = np.floor(exact + 1e-9).astype(int)
    left = round(min(1.0, total) * len(indices)) - sizes.sum()
    sizes[np.argsort(sizes - exact, kind="stable")[:left]] += 1
    if (sizes < 1).any():
        words = " ".join(f"{part}={share:g}" for part, share in shares.items())
        raise DatasetError(
            f"{len(indices)} episodes are too few to split into {words}: each part needs at least one; "
            f"{math.ceil(1 / min(shares.values()) - 1e-9)} episodes are enough"
        )
    shuffled = np.random.default_rng(seed).permutation(np.sort(np.asarray(indices, dtype=np.int64)))
    ends = np.cumsum(sizes)
    parts = {
        part: sorted(shuffled[end - size : end].tolist()) for part, size, end in zip(shares, sizes, ends, strict=True)
    }
    return Split(name, seed, {"by": "episode", "shares": dict(shares), "episodes": len(indices)}, parts)


def check_no_copies(dataset: Dataset) -> None:
    """Check that no episode is a copy of another one, because a split could put the two into different parts.

    Args:
        dataset: Dataset whose episodes are compared. Damaged episodes are left out.

    Raises:
        DatasetError: If an episode is a copy of another one.
    """
    found = copies((dataset.path / entry.name, entry.content) for entry in entries(dataset) if not entry.error)
    if found:
        raise DatasetError(
            f"the same recording more than once: {copies_words(found)}; in a split one could be trained and the other "
            f"tested on; svfl-data filter {dataset.path} NEW --once takes the first of each"
        )


def load_split(dataset: Dataset, name: str) -> Split:
    """Load a stored split.

    Args:
        dataset: Dataset that the split is stored in.
        name: Name of the split.

    Raises:
        FormatError: If the file is not a split, was edited, or has another format version.
        DatasetError: If no split of this name is stored, or the split names episodes that the dataset lacks.
        UsageError: If the name cannot be the name of a split.

    Example:
        >>> _ = split_episodes(dataset.indices, {"train": 0.5, "test": 0.5}, seed=0).save(dataset)
        >>> sorted(load_split(dataset, "default").parts)
        ['test', 'train']
    """
    file = split_file(dataset, name)
    refuse_link(file.parent)
    try:
        found = read_side_file(file)
    except FileNotFoundError as error:
        stored = sorted(other.stem for other in file.parent.glob("*.json") if NAME.fullmatch(other.stem))
        raise DatasetError(f"{dataset.path}: no split {name!r}; it has {_named(stored)}") from error
    check_format(found, FORMAT, FORMAT_VERSION, file, "not a split")
    whole = parse_as(found, SplitFile, f"{file}: fields of a split are missing or have a wrong type")
    split = Split(name, whole.seed, whole.rule, whole.parts)
    together = [index for part in split.parts.values() for index in part]
    if split.sha256 != whole.sha256 or len(set(together)) != len(together):
        raise FormatError(f"{file}: was edited (its parts do not match its hash)")
    if missing := sorted(set(together) - set(dataset.indices)):
        raise DatasetError(
            f"{file}: the dataset lacks {len(missing)} of its {len(together)} episodes ({_named(missing)}); put them "
            f"back, or draw it again among those there are: svfl-data split {dataset.path} --split {name} --replace, "
            "or under another name"
        )
    return split


def _named(things: Sequence[object]) -> str:
    """Return the first `MOST_NAMED` numbers or names as text, and how many more there are."""
    more = f" and {len(things) - MOST_NAMED} more" if len(things) > MOST_NAMED else ""
    return (", ".join(str(one) for one in things[:MOST_NAMED]) or "none") + more


def train_test_split(labels: np.ndarray, train: int, test: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Draw a training set that is balanced over the classes, and a test set that does not depend on the seed.

    Args:
        labels: Class of each sample, shape (S,).
        train: Number of training samples.
        test: Number of test samples.
        seed: Seed with which the training samples are drawn from the samples that are not test samples.

    Returns:
        Indices of the training samples, shape (train,), and of the test samples, shape (test,). No sample is in both.

    Raises:
        UsageError: If a number of samples is not positive.
        DatasetError: If there are not enough samples.
    """
    if train < 1 or test < 1:
        raise UsageError(f"asked for {train} training and {test} test samples; both must be at least 1")
    if train + test > len(labels):
        raise DatasetError(
            f"asked for {train} training and {test} test samples, but the dataset has {len(labels)}; "
            f"with this test set at most {max(0, len(labels) - test)} can be trained on"
        )
    shuffled = np.random.default_rng(0).permutation(len(labels))  # a constant: every run has the same test set
    test_index, pool = shuffled[:test], np.random.default_rng(seed).permutation(shuffled[test:])
    turn = np.empty(len(pool), dtype=np.int64)  # for each sample, the number of samples of its class before it
    for label in np.unique(labels):
        own = labels[pool] == label
        turn[own] = np.arange(own.sum())
    balanced = pool[np.argsort(turn, kind="stable")]
    return balanced[:train], np.sort(test_index)
