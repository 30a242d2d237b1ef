"""Checks of recorded data: functions that describe the errors of an episode or a dataset.

A check takes a valid episode (`svfl_data.schema.validity`) and yields findings. Reading an episode already checks that
it is valid and that its file is whole. `check_file` turns the errors of reading into findings, too.
"""

import re
from collections.abc import Iterator
from pathlib import Path

from svfl_data.checks.between import Between
from svfl_data.checks.episode_checks import check_episode
from svfl_data.checks.finding import Finding, Severity
from svfl_data.checks.usable import check_usable, sound
from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import FormatError, OldVersionError, SvflError
from svfl_data.recording.index_locks import INFLIGHT
from svfl_data.recording.journal import SUFFIX
from svfl_data.storage.damage import damaged_arrays
from svfl_data.storage.reader import read_episode

__all__ = ["Finding", "Severity", "check_dataset", "check_episode", "check_file", "check_usable", "sound"]


def check_file(path: Path) -> list[Finding]:
    """Return everything that is wrong with one episode file, from its seal to its content.

    Args:
        path: Path of the episode file.

    Returns:
        Findings of all checks. If the file cannot be read, the first finding gives the error, and the others name the
        arrays that are damaged.

    Raises:
        OldVersionError: If the episode is of version 1 of the format.

    Example:
        >>> [one.words for one in check_file(dataset.episode_path(0)) if one.severity == "error"]
        []
    """
    try:
        return check_episode(read_episode(path, images=False))
    except OldVersionError:
        raise
    except SvflError as problem:
        return unreadable(str(path), problem)


def check_dataset(dataset: Dataset) -> Iterator[list[Finding]]:
    """Yield everything that is wrong with a dataset: one list of findings per episode, then one for the whole dataset.

    The last list states what does not match between the episodes (`svfl_data.checks.between`), and names
    unfinished episodes.

    Args:
        dataset: Dataset to check.

    Raises:
        OldVersionError: If an episode is of version 1 of the format.

    Example:
        >>> [one.words for found in check_dataset(dataset) for one in found if one.severity == "error"]
        []
    """
    between = Between(dataset)
    for index in dataset.indices:
        name = str(dataset.episode_path(index))
        try:
            reader = dataset.episode(index)
            name = str(reader.extent)
            episode = dataset.read(index, images=False)
            between.add(index, reader, episode)
        except OldVersionError:
            raise
        except SvflError as problem:
            yield unreadable(name, problem)
            continue
        yield check_episode(episode)
    shared = between.findings()
    unfinished = sorted((dataset.path / INFLIGHT).glob(f"*{SUFFIX}"))
    if unfinished:
        names = ", ".join(file.stem for file in unfinished)
        words = f"being written, or left by a writer that was stopped: {names}; if so, run svfl-data repair"
        shared.append(Finding(str(dataset.path), "", None, "note", words))
    yield shared


def unreadable(name: str, problem: SvflError) -> list[Finding]:
    """Turn the error of reading an episode file into findings.

    Args:
        name: Path of the file.
        problem: Error that reading the file has raised.

    Returns:
        One finding for the error, with the field and index that its message names, then one for each damaged array.
    """
    words = str(problem)
    field = re.search(r"field (\S+?)[ ']", words)
    index = re.search(r"at index \((\d+)", words)
    first = Finding(
        name, field[1] if field else "", int(index[1]) if index else None, "error", words.removeprefix(f"{name}: ")
    )
    broken = isinstance(problem, FormatError) and "seal" in words and Path(name).is_file()
    damaged = damaged_arrays(Path(name)) if broken else []
    return [first, *(Finding(name, path, None, "error", "damaged: cannot be read") for path in damaged)]
