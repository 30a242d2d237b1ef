"""Opening of the dataset or the episode that a path and ``--episode`` name."""

from pathlib import Path

from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import DatasetError, StorageError, UsageError
from svfl_data.schema.episode import Episode
from svfl_data.storage.reader import EpisodeReader
from svfl_data.storage.store import read_episode

EPISODE_SUFFIXES = (".hdf5", ".h5")


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
