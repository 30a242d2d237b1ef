"""Who writes which episode of a dataset: claims that hold between processes, and publication that never overwrites.

An episode that is being written is a journal ``.inflight/episode_000012.journal``, created exclusively (the claim) and
locked while its writer lives (the kernel lets go when a process dies). Publishing puts the whole file under its final
name before the journal goes; whoever creates a journal looks for the final name afterwards, so no index is taken twice.
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
from svfl_data.schema.episode import Meta
from svfl_data.storage.store import Rows, largest_size, write_sealed
from svfl_data.system.atomic_io import name_unless_taken, sync_folder
from svfl_data.system.regular_file import open_regular

NEXT = -1
"""In place of an episode's index: the first after all that exist or are being written."""
INFLIGHT = ".inflight"
JOURNAL = re.compile(rf"episode_(\d{{6,18}}){re.escape(SUFFIX)}", re.ASCII)
PART = ".part"
SETUP = ".setup"
"""Suffix of the file beside a journal that says with what its writer records (`svfl_data.recording.consistency`)."""


def inflight(folder: Path) -> Path:
    """The folder of a dataset's unfinished episodes; made if it does not exist.

    Raises:
        FormatError: If it is a link or a file.
        StorageError: If the disk refuses.
    """
    return inner_folder(folder, INFLIGHT)


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold a folder; waits for whoever else does."""
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
        dataset: Where to.
        index: Which one, or `NEXT`.

    Returns:
        The index, and the descriptor and path of its new, empty, locked journal.

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
                else "is being written, or its writer died; svfl-data repair ends it"
            )
            raise DatasetError(f"{dataset.path}: episode {index} {state}")


def _create(path: Path) -> int | None:
    """A new locked file; None if there is one already."""
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
    os.close(descriptor)  # a repair that came between creation and lock took it for an abandoned one
    return None


def take_over(path: Path) -> int | None:
    """Lock the journal of a writer that is gone; None if the writer lives, or the journal is gone too.

    Raises:
        FormatError: If it is no ordinary file.
        OSError: If it cannot be opened or locked.
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


def build(dataset: Dataset, meta: Meta, arrays: Mapping[str, Rows]) -> Path:
    """Write the sealed file of a claimed episode aside.

    Raises:
        StorageError: If the disk refuses; nothing is left behind but the journal.
    """
    part = inflight(dataset.path) / f"episode_{meta.index:06d}{PART}"
    try:
        descriptor = open_regular(part, os.O_RDWR | os.O_CREAT | os.O_TRUNC)
        try:
            write_sealed(descriptor, meta, arrays)
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
    except OSError as error:  # a disk that is gone
        return f"free space unknown: {error.strerror}"
    return f"{free.f_bavail * free.f_frsize} free"


def publish(part: Path, path: Path) -> None:
    """Give a whole file its final name, which nothing may have yet.

    Raises:
        FileExistsError: If the name is taken; nothing is changed.
        StorageError: If the disk refuses.
    """
    try:
        name_unless_taken(part, path)
        sync_folder(path.parent)
        part.unlink(missing_ok=True)
    except FileExistsError:
        raise
    except OSError as error:
        raise StorageError(f"cannot publish {path}: {error.strerror}") from error
    with suppress(SvflError):  # the index lacks a line then, and is mended by whoever reads it next
        append_index(path.parent, path)
