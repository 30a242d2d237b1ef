"""Functions that several commands use: common arguments, and opening the dataset or episode that a path names."""

import argparse
import json
from pathlib import Path
from typing import Any

from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import DatasetError, StorageError, UsageError
from svfl_data.schema.episode import Episode
from svfl_data.storage.reader import EpisodeReader
from svfl_data.storage.store import read_episode
from svfl_data.system.command_line import Parser, natural

EPISODE_SUFFIXES = (".hdf5", ".h5")


def add_path(parser: Parser) -> None:
    """Add the argument that names a dataset or an episode file."""
    parser.add_argument("path", type=Path, metavar="PATH", help="dataset folder, or episode file (.hdf5)")


def add_dataset(parser: Parser) -> None:
    """Add the argument that names a dataset."""
    parser.add_argument("path", type=Path, metavar="PATH", help="dataset folder")


def add_episode(parser: Parser, otherwise: str = "the first one") -> None:
    """Add the option ``--episode`` that chooses an episode of a dataset.

    Args:
        parser: Parser of the command.
        otherwise: Words for the help text that say which episode is used without the option.
    """
    parser.add_argument(
        "--episode", type=natural, metavar="N",
        help=f"number of the episode, if PATH is a dataset folder; at least 0 (default: {otherwise})",
    )  # fmt: skip


def add_json(parser: Parser) -> None:
    """Add the option ``--json`` for output that programs can read."""
    parser.add_argument("--json", action="store_true", help="print JSON instead of text")


def add_allowances(parser: Parser) -> None:
    """Add the options ``--varies`` and ``--once``, which decide the episodes that a new dataset may contain."""
    parser.add_argument(
        "--varies", nargs="+", default=[], metavar="NAME",
        help="arrays, or groups of arrays, in which the copied episodes may differ, such as "
        "cameras/front/T_base_camera (default: only those in which the source datasets already allow differences)",
    )  # fmt: skip
    parser.add_argument(
        "--once",
        action="store_true",
        help="copy only the first of several copies of one recording (default: copies of one recording are an error)",
    )


def left_out_words(number: int) -> str:
    """Return words on how many copies were left out, for the end of a line; empty if there were none.

    Args:
        number: Number of copies that were left out.
    """
    return f"; {number} {'copy' if number == 1 else 'copies'} left out" if number else ""


def is_episode(path: Path) -> bool:
    """Return whether a path names an episode file rather than a dataset folder."""
    return path.is_file() or path.suffix in EPISODE_SUFFIXES


def read(path: Path, index: int | None) -> Episode:
    """Read the episode that a path and ``--episode`` name into memory.

    Args:
        path: Dataset folder or episode file.
        index: Index of the episode in the dataset. None for the first episode, or for an episode file.

    Raises:
        UsageError: If both the path and the index name an episode.
        SvflError: If the episode cannot be read.
    """
    try:
        if is_episode(path):
            _refuse_index(path, index)
            return read_episode(path)
        dataset = Dataset.open(path)
        return dataset.read(_first(dataset) if index is None else index)
    except OSError as error:
        raise StorageError(f"cannot read {path}: {error.strerror}") from error


def reader(path: Path, index: int | None) -> EpisodeReader:
    """Open the episode that a path and ``--episode`` name, to be read lazily.

    Args:
        path: Dataset folder or episode file.
        index: Index of the episode in the dataset. None for the first episode, or for an episode file.

    Raises:
        UsageError: If both the path and the index name an episode.
        SvflError: If the episode cannot be opened.
    """
    if is_episode(path):
        _refuse_index(path, index)
        return EpisodeReader.of_file(path)
    dataset = Dataset.open(path)
    return dataset.episode(_first(dataset) if index is None else index)


def _refuse_index(path: Path, index: int | None) -> None:
    if index is not None:
        raise UsageError(f"--episode {index}: {path} is one episode already; --episode chooses from a dataset folder")


def _first(dataset: Dataset) -> int:
    indices = dataset.indices
    if not indices:
        raise DatasetError(f"{dataset.path}: the dataset has no episodes yet")
    return indices[0]


def yes_no(text: str) -> bool:
    """Parse ``yes`` or ``no``; used as an argument type."""
    if text not in ("yes", "no"):
        raise argparse.ArgumentTypeError(f"{text!r} is neither yes nor no")
    return text == "yes"


def print_json(value: Any) -> None:  # noqa: ANN401 - any JSON value
    """Print a value as JSON, with characters that are not ASCII as escapes, because they may not be harmless text.

    Args:
        value: Any JSON value.
    """
    print(json.dumps(value, indent=2))
