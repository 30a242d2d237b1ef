"""The output folder of a training run, which belongs to one configuration and is never silently shared by two."""

import errno
import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from svfl_data.errors import FormatError, StorageError, TrainingError
from svfl_data.system.leftovers import clear_files
from svfl_data.system.side_files import read_json
from svfl_models.training.writing import write_json

NO_LOCKS = (errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS)
"""Error numbers with which a file system answers that it has no locks."""
CONFIG = "config.json"
CHECKPOINT = "checkpoint.ckpt"
METRICS = "metrics.csv"
PREDICTIONS = "predictions.csv"
LEARNING_CURVE = "learning_curve.png"
CONFUSION = "confusion_matrix.png"
REPORT = "report.md"
RESULT = "result.json"
EVALUATION = "evaluation.json"
ACTION_ERRORS, ACTION_ERRORS_PAGE = "action_errors.json", "action_errors.md"
OWN = (
    CHECKPOINT, METRICS, PREDICTIONS, LEARNING_CURVE, CONFUSION, REPORT, RESULT, EVALUATION, ACTION_ERRORS,
    ACTION_ERRORS_PAGE,
)  # fmt: skip
WORTH = (CHECKPOINT, RESULT)
"""Files that make a run worth keeping. A folder with neither may be taken for a run with another configuration."""


@contextmanager
def held(out: Path) -> Iterator[None]:
    """Lock a folder against other processes for the duration of the context.

    Unfinished files that killed processes have left in the folder are removed.

    Args:
        out: Folder to lock, which is created if it does not exist.

    Raises:
        TrainingError: If another process works in the folder.
        StorageError: If the folder cannot be created or locked.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(out, os.O_RDONLY)  # the kernel drops the lock when the process dies
    except OSError as error:
        raise StorageError(f"{out}: {error.strerror or error}") from error
    try:
        _lock(descriptor, out)
        clear_files(out)
        yield
    finally:
        os.close(descriptor)


def _lock(descriptor: int, out: Path) -> None:
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise TrainingError(f"{out}: another process is working in this folder") from error
    except OSError as error:
        if error.errno not in NO_LOCKS:  # without locks, no process can be kept out
            raise StorageError(f"{out}: {error.strerror or error}") from error


def claim(out: Path, config: dict[str, Any]) -> None:
    """Reserve a folder for a run, and write the run's configuration into it.

    The files of an earlier run are removed from the folder if that run had the same configuration, or left neither a
    checkpoint nor a result (`WORTH`).

    Args:
        out: Folder of the run, locked by this process (`held`).
        config: Configuration of the run, as plain values.

    Raises:
        TrainingError: If the folder belongs to a run with another configuration or to a dataset, or holds files that
            the run would overwrite.
        StorageError: If the folder cannot be written.
    """
    found = _read_config(out)
    if found is not None and found != config and any((out / name).exists() for name in WORTH):
        changed = [
            f"{key} = {found.get(key)!r}, now {value!r}" for key, value in config.items() if found.get(key) != value
        ]
        raise TrainingError(f"{out} holds a training run with {'; '.join(changed)}; choose another --out or delete it")
    occupied = [name for name in ("dataset.json", *OWN) if (out / name).exists()]
    if found is None and occupied:
        raise TrainingError(f"{out} holds {occupied[0]}, which is not from a training run; choose another --out")
    try:
        out.mkdir(parents=True, exist_ok=True)
        for name in OWN:
            (out / name).unlink(missing_ok=True)
    except OSError as error:
        raise StorageError(f"{out}: {error.strerror or error}") from error
    write_json(out / CONFIG, config)


def _read_config(out: Path) -> dict[str, Any] | None:
    path = out / CONFIG
    if not path.is_file():
        return None
    try:
        found = read_json(path)
    except (OSError, FormatError) as error:
        raise TrainingError(
            f"{path} is not the configuration of a training run ({error}); choose another --out"
        ) from error
    return found if isinstance(found, dict) else {}
