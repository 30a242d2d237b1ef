"""What the commands share: finding the dataset or episode that a path names, and the common arguments."""

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
    parser.add_argument("path", type=Path, metavar="PATH", help="dataset folder or episode file")


def add_dataset(parser: Parser) -> None:
    """Add the argument that names a dataset."""
    parser.add_argument("path", type=Path, metavar="PATH", help="dataset folder")


def add_episode(parser: Parser, otherwise: str = "the first") -> None:
    """Add the option that chooses an episode of a dataset."""
    parser.add_argument(
        "--episode", type=natural, metavar="N", help=f"number of the episode in the dataset (default: {otherwise})"
    )


def add_json(parser: Parser) -> None:
    """Add the option for output that a machine reads."""
    parser.add_argument("--json", action="store_true", help="print JSON")


def add_allowances(parser: Parser) -> None:
    """Add the options that say what the episodes of a new dataset may be."""
    parser.add_argument(
        "--varies", nargs="+", default=[], metavar="NAME",
        help="let episodes differ in this path or group, e.g. cameras/front/T_base_camera",
    )  # fmt: skip
    parser.add_argument("--once", action="store_true", help="of copies of one recording, take the first only")


def left_out_words(number: int) -> str:
    """How many copies were left out, for the end of a line."""
    return f"; {number} {'copy' if number == 1 else 'copies'} left out" if number else ""


def is_episode(path: Path) -> bool:
    """Whether a path names an episode file rather than a dataset folder."""
    return path.is_file() or path.suffix in EPISODE_SUFFIXES


def read(path: Path, index: int | None) -> Episode:
    """The episode that a path and ``--episode`` name, in memory.

    Raises:
        UsageError: If both name an episode.
        SvflError: If it cannot be read.
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
    """The episode that a path and ``--episode`` name, to be read lazily; errors as `read`."""
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
    """Argument type: yes or no."""
    if text not in ("yes", "no"):
        raise argparse.ArgumentTypeError(f"{text!r} is neither yes nor no")
    return text == "yes"


def print_json(value: Any) -> None:  # noqa: ANN401 - any JSON value
    """Print a value for a machine to read; what is not ASCII, and so may be no harmless text, as escapes."""
    print(json.dumps(value, indent=2))
