"""Claims of episode indices that hold between processes, and publication of episodes that never overwrites a file.

An episode that is being written has a journal ``.inflight/episode_000012.journal``. The journal is created exclusively,
which is the claim, and stays locked while its writer is running (the kernel releases the lock when a process dies).
Publishing gives the whole file its final name before the journal is removed. A process that creates a journal looks for
the final name afterwards, so no index is taken twice.
"""

import fcntl
import os
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from svfl_data.datasets.dataset import Dataset, inner_folder
from svfl_data.datasets.index import append_index
from svfl_data.errors import DatasetError, StorageError, SvflError
from svfl_data.recording.journal import SUFFIX
from svfl_data.schema.declarations import STANDARD, Declarations
from svfl_data.schema.episode import Meta
from svfl_data.storage.store import Rows, largest_size, write_sealed
from svfl_data.system.atomic_io import name_unless_taken, sync_folder
from svfl_data.system.regular_file import open_regular

NEXT = -1
"""Stands for the first index after those of all episodes that exist or are being written."""
INFLIGHT = ".inflight"
JOURNAL = re.compile(rf"episode_(\d{{6,18}}){re.escape(SUFFIX)}", re.ASCII)
PART = ".part"
SETUP = ".setup"
"""Suffix of the file beside a journal that holds the setup of its writer (`svfl_data.recording.consistency`)."""


def inflight(folder: Path) -> Path:
    """Return the folder of a dataset's unfinished episodes, and create it if it does not exist.

    Args:
        folder: Folder of the dataset.

    Raises:
        FormatError: If there is a link or a file of its name.
        StorageError: If the disk refuses.
    """
    return inner_folder(folder, INFLIGHT)


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold the lock of a folder during the ``with`` block, after waiting until nobody else holds the lock.

    Raises:
        StorageError: If the folder cannot be locked.
    """
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        except OSError as error:
            raise StorageError(f"cannot lock {folder}: {error.strerror}") from error
        yield
    finally:
        os.close(descriptor)


def claim(dataset: Dataset, index: int = NEXT) -> tuple[int, int, Path]:
    """Claim an episode of a dataset for this process.

    Args:
        dataset: Dataset into which the episode will be written.
        index: Index of the episode, or `NEXT`.

    Returns:
        Index of the episode, and descriptor and path of its new, empty, locked journal.

    Raises:
        DatasetError: If the wanted episode exists or is being written.
        StorageError: If the disk refuses.
    """
    folder = inflight(dataset.path)
    wanted = index
    while True:
        if wanted == NEXT:
            journals = (JOURNAL.fullmatch(name) for name in os.listdir(folder))
            index = max([-1, *dataset.indices, *(int(match[1]) for match in journals if match)]) + 1
        path = folder / f"episode_{index:06d}{SUFFIX}"
        descriptor = _create(path)
        if descriptor is not None and index not in dataset.indices:
            return index, descriptor, path
        if descriptor is not None:
            path.unlink()
            os.close(descriptor)
        if wanted != NEXT:
            state = (
                "exists already"
                if descriptor is not None
                else "is being written, or its writer died; svfl-data repair makes an episode of what it left"
            )
            raise DatasetError(f"{dataset.path}: episode {index} {state}")


def _create(path: Path) -> int | None:
    """Create and lock a new file, and return its descriptor; None if the file exists already."""
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o644)
    except FileExistsError:
        return None
    except OSError as error:
        raise StorageError(f"cannot create {path}: {error.strerror}") from error
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
    except OSError as error:
        path.unlink(missing_ok=True)
        os.close(descriptor)
        raise StorageError(f"cannot lock {path}: {error.strerror}") from error
    if os.fstat(descriptor).st_nlink:
        return descriptor
    os.close(descriptor)  # a repair between creation and lock removed the file as abandoned
    return None


def take_over(path: Path) -> int | None:
    """Open and lock the journal of a writer that is gone.

    Args:
        path: Path of the journal.

    Returns:
        Descriptor of the journal, which the caller must close; None if the writer is running or the journal is gone.

    Raises:
        FormatError: If the journal is not an ordinary file.
        OSError: If the journal cannot be opened or locked for another reason.
    """
    try:
        descriptor = open_regular(path, os.O_RDWR)
    except FileNotFoundError:
        return None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        return None
    except OSError:
        os.close(descriptor)
        raise
    if os.fstat(descriptor).st_nlink:
        return descriptor
    os.close(descriptor)
    return None


def build(dataset: Dataset, meta: Meta, arrays: Mapping[str, Rows], declarations: Declarations = STANDARD) -> Path:
    """Write the sealed file of a claimed episode under a temporary name in the folder of unfinished episodes.

    Args:
        dataset: Dataset to which the episode belongs.
        meta: Metadata of the episode.
        arrays: Arrays of the episode, by dataset path.
        declarations: Declarations of the arrays.

    Returns:
        Path of the temporary file, for `publish`.

    Raises:
        StorageError: If the disk refuses; only the journal is left behind.
    """
    part = inflight(dataset.path) / f"episode_{meta.index:06d}{PART}"
    try:
        descriptor = open_regular(part, os.O_RDWR | os.O_CREAT | os.O_TRUNC)
        try:
            write_sealed(descriptor, meta, arrays, declarations)
        finally:
            os.close(descriptor)
    except BaseException as error:
        with suppress(OSError):
            part.unlink(missing_ok=True)
        if not isinstance(error, OSError):
            raise
        raise StorageError(
            f"cannot write episode {meta.index} to {dataset.path}: {error.strerror} (at most {largest_size(arrays)} "
            f"bytes needed, {_free_words(dataset.path)}); its readings are kept in {INFLIGHT}, make room and "
            "seal again or run svfl-data repair; everything written before is intact"
        ) from error
    return part


def _free_words(folder: Path) -> str:
    try:
        free = os.statvfs(folder)
    except OSError as error:  # the disk may be gone
        return f"free space unknown: {error.strerror}"
    return f"{free.f_bavail * free.f_frsize} free"


def publish(part: Path, path: Path, replace: bool = False) -> None:
    """Give a whole episode file its final name, and add the episode to the index.

    Args:
        part: Path of the file that `build` has written.
        path: Final path of the episode file.
        replace: Whether the file takes the place of another one with that name.

    Raises:
        FileExistsError: If the name is taken and is not to be replaced; nothing is changed then.
        StorageError: If the disk refuses.
    """
    try:
        os.replace(part, path) if replace else name_unless_taken(part, path)
        sync_folder(path.parent)
        part.unlink(missing_ok=True)
    except FileExistsError:
        raise
    except OSError as error:
        raise StorageError(f"cannot publish {path}: {error.strerror}") from error
    with suppress(SvflError):  # then the index lacks a line, which its next reader adds
        append_index(path.parent, path)
