"""Splits that are the same wherever they are drawn: by sample for one experiment, by episode to be stored.

Steps of one episode are nearly copies of each other. A dataset is therefore only ever split by whole episodes, and the
split is stored beside them, so that everyone trains and tests on the same ones.
"""

import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from svfl_data.atomically import write_atomically
from svfl_data.dataset import Dataset
from svfl_data.episode import canonical_json
from svfl_data.errors import DatasetError, FormatError, StorageError, UsageError

FOLDER = "splits"
FORMAT = "svfl-split"
FORMAT_VERSION = "1.0"
NAME = re.compile(r"[\w-]+")


@dataclass(frozen=True)
class Split:
    """Which episodes of a dataset serve which purpose.

    Attributes:
        name: Its name, and that of its file.
        seed: With which it was drawn.
        rule: How it was drawn: the shares asked for, and from how many episodes.
        parts: Indices of the episodes of each part, ascending; disjoint.
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
        """Hash of which episodes are in which part, in hexadecimal; does not depend on names or on how it was drawn."""
        return hashlib.sha256(canonical_json(self.parts).encode()).hexdigest()

    def save(self, dataset: Dataset) -> Path:
        """Store it beside the dataset's episodes; returns the file.

        Raises:
            DatasetError: If another split of this name is stored already; experiments may rest on it.
            StorageError: If the disk refuses.
        """
        file = split_file(dataset, self.name)
        try:
            file.parent.mkdir(exist_ok=True)
        except OSError as error:
            raise StorageError(f"cannot create {file.parent}: {error.strerror}") from error
        content = {"format": FORMAT, "format_version": FORMAT_VERSION, "sha256": self.sha256, **asdict(self)}
        try:
            write_atomically(file, (canonical_json(content) + "\n").encode(), replace=False)
        except StorageError:
            if not file.exists():
                raise  # else it is stored already, perhaps by a process that was first by an instant
            if load_split(dataset, self.name).sha256 != self.sha256:
                raise DatasetError(f"{file} holds another split; choose another name, or delete it first") from None
        return file


def split_file(dataset: Dataset, name: str) -> Path:
    """File of a split, whether or not it exists.

    Raises:
        UsageError: If the name cannot be one.
    """
    if not NAME.fullmatch(name):
        raise UsageError(f"{name!r} cannot be the name of a split: use letters, digits, - and _")
    return dataset.path / FOLDER / f"{name}.json"


def split_episodes(indices: Sequence[int], shares: Mapping[str, float], seed: int, name: str = "default") -> Split:
    """Draw which episodes serve which purpose.

    Args:
        indices: The episodes, in any order.
        shares: Part to its share of the episodes, such as ``{"train": 0.8, "valid": 0.1, "test": 0.1}``; they sum to at
            most 1. Each part gets its share rounded down, and what is left over goes, one each, to those that
            rounding took most from.
        seed: The same seed and episodes give the same split.
        name: Its name.

    Raises:
        UsageError: If the shares are not shares, or the name cannot be one.
        DatasetError: If there are too few episodes to give one to each part.
    """
    total = sum(shares.values())
    if not shares or min(shares.values()) <= 0 or total > 1 + 1e-9:
        raise UsageError(f"shares must be positive and sum to at most 1, asked for {dict(shares)}")
    exact = np.array(list(shares.values())) * len(indices)
    sizes = np.floor(exact + 1e-9).astype(int)
    left = round(min(1.0, total) * len(indices)) - sizes.sum()
    sizes[np.argsort(sizes - exact, kind="stable")[:left]] += 1
    if (sizes < 1).any():
        raise DatasetError(f"{len(indices)} episodes are too few to split into {dict(shares)}")
    shuffled = np.random.default_rng(seed).permutation(np.sort(np.asarray(indices, dtype=np.int64)))
    ends = np.cumsum(sizes)
    parts = {
        part: sorted(shuffled[end - size : end].tolist()) for part, size, end in zip(shares, sizes, ends, strict=True)
    }
    return Split(name, seed, {"by": "episode", "shares": dict(shares), "episodes": len(indices)}, parts)


def load_split(dataset: Dataset, name: str) -> Split:
    """A stored split.

    Raises:
        FormatError: If it is not a split, was edited, or is of another version.
        DatasetError: If it is not stored, or names episodes that the dataset lacks.
    """
    file = split_file(dataset, name)
    try:
        found = json.loads(file.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        stored = sorted(other.stem for other in file.parent.glob("*.json") if NAME.fullmatch(other.stem))
        raise DatasetError(f"{dataset.path}: no split {name!r}; it has {', '.join(stored) or 'none'}") from error
    except (OSError, ValueError) as error:
        raise FormatError(f"{file}: not readable as JSON ({error})") from error
    if not isinstance(found, dict) or found.get("format") != FORMAT:
        raise FormatError(f"{file}: not a split (format is not {FORMAT!r})")
    if str(found.get("format_version")).split(".")[0] != FORMAT_VERSION.split(".")[0]:
        raise FormatError(f"{file}: format version {found.get('format_version')}; this software reads 1.x")
    try:
        split = Split(found["name"], found["seed"], found["rule"], found["parts"])
        together = [index for part in split.parts.values() for index in part]
    except (KeyError, TypeError, AttributeError) as error:
        raise FormatError(f"{file}: not a whole split ({error})") from error
    if split.sha256 != found.get("sha256") or len(set(together)) != len(together):
        raise FormatError(f"{file}: was edited (its parts do not match its hash)")
    if missing := sorted(set(together) - set(dataset.indices)):
        raise DatasetError(f"{file}: names {len(missing)} episodes that the dataset lacks, the first is {missing[0]}")
    return split


def train_test_split(labels: np.ndarray, train: int, test: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Draw a training set that is balanced over the classes, and a test set that does not depend on the seed.

    Args:
        labels: Class of each sample, shape (S,).
        train: Samples to train on.
        test: Samples to test on.
        seed: Chooses the training samples among those that are not test samples.

    Returns:
        Indices of the training and of the test samples; disjoint.

    Raises:
        UsageError: If a size is not positive.
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
    turn = np.empty(len(pool), dtype=np.int64)  # how many of its class come before it
    for label in np.unique(labels):
        own = labels[pool] == label
        turn[own] = np.arange(own.sum())
    balanced = pool[np.argsort(turn, kind="stable")]
    return balanced[:train], np.sort(test_index)
