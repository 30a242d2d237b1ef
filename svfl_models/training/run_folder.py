"""The output folder of a training run: claimed for one configuration, never silently shared by two."""

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
"""What a file system without locks answers."""
CONFIG = "config.json"
CHECKPOINT = "checkpoint.ckpt"
METRICS = "metrics.csv"
PREDICTIONS = "predictions.csv"
LEARNING_CURVE = "learning_curve.png"
CONFUSION = "confusion_matrix.png"
REPORT = "report.md"
RESULT = "result.json"
EVALUATION = "evaluation.json"
OWN = (CHECKPOINT, METRICS, PREDICTIONS, LEARNING_CURVE, CONFUSION, REPORT, RESULT, EVALUATION)
WORTH = (CHECKPOINT, RESULT)
"""Without one of these a run has come to nothing, and its folder may be taken for another."""


@contextmanager
def held(out: Path) -> Iterator[None]:
    """Keep other processes out of a folder, as long as the context lasts; leftovers of killed ones are cleared away.

    Args:
        out: The folder; it need not exist.

    Raises:
        TrainingError: If another process works in it.
        StorageError: If it cannot be created.
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
        if error.errno not in NO_LOCKS:  # where there are none, nobody can be kept out
            raise StorageError(f"{out}: {error.strerror or error}") from error


def claim(out: Path, config: dict[str, Any]) -> None:
    """Make a folder, which is held, the home of a run and write the run's configuration into it.

    A folder is cleared of the files of an earlier run with the same configuration, or of one that came to nothing.

    Args:
        out: The folder.
        config: Configuration of the run, plain values.

    Raises:
        TrainingError: If the folder belongs to a run with another configuration, to a dataset, or holds files that
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
