"""The output folder of a training run, which belongs to one configuration and is never silently shared by two."""

import errno
import fcntl
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from svfl_data.errors import StorageError, TrainingError, UsageError
from svfl_data.system.leftovers import clear_files
from svfl_models.configuration.yaml_file import PROGRAM, read_yaml, text_of
from svfl_models.training.writing import write_text

NO_LOCKS = (errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS)
"""Error numbers with which a file system answers that it has no locks."""
CONFIG = "run.yaml"
CHECKPOINT = "checkpoint.ckpt"
METRICS = "metrics.csv"
PREDICTIONS = "predictions.csv"
LEARNING_CURVE = "learning_curve.png"
CONFUSION = "confusion_matrix.png"
REPORT = "report.md"
RESULT = "result.json"
EVALUATION = "evaluation.json"
PROVENANCE = "provenance.json"
RECONSTRUCTIONS = "reconstructions.png"
ROLLOUT = "rollout.gif"
ACTION_ERRORS, ACTION_ERRORS_PAGE = "action_errors.json", "action_errors.md"
OWN = (
    CHECKPOINT, METRICS, PREDICTIONS, LEARNING_CURVE, CONFUSION, REPORT, RESULT, EVALUATION, PROVENANCE,
    RECONSTRUCTIONS, ROLLOUT, ACTION_ERRORS, ACTION_ERRORS_PAGE,
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


def claim(out: Path, program: str, config: dict[str, Any], beside: dict[str, Any] | None = None) -> None:
    """Reserve a folder for a run, and write the run's settings into it, which ``svfl-train rerun`` reads.

    The files of an earlier run are removed from the folder if that run had the same configuration, or left neither a
    checkpoint nor a result (`WORTH`).

    Args:
        out: Folder of the run, locked by this process (`held`).
        program: Name of the command of ``svfl-train`` that does the run.
        config: Configuration of the run, as plain values, which tells it from other runs.
        beside: Settings that do not tell it from other runs, such as the device.

    Raises:
        TrainingError: If the folder belongs to a run with another configuration or to a dataset, or holds files that
            the run would overwrite.
        StorageError: If the folder cannot be written.
    """
    found = read_config(out)
    if found is not None and not is_same(found, program, config) and any((out / name).exists() for name in WORTH):
        changed = [
            f"{key} = {found.get(key)!r}, now {value!r}"
            for key, value in ({PROGRAM: program} | config).items()
            if found.get(key) != value
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
    write_config(out, program, config, beside)


def claim_or_resume(
    out: Path, program: str, config: dict[str, Any], beside: dict[str, Any], load: Callable[[Path], object]
) -> Path | None:
    """Reserve a folder for a run as `claim` does, or find the interrupted run of the same configuration in it.

    Args:
        out: Folder of the run, locked by this process (`held`).
        program: Name of the command of ``svfl-train`` that does the run.
        config: Configuration of the run, as plain values, which tells it from other runs.
        beside: Settings that do not tell it from other runs, such as the device.
        load: Opens a checkpoint of the program, and raises FormatError if it is damaged.

    Returns:
        The checkpoint that the run continues from. None for a run that begins, also on the folder of a finished run.

    Raises:
        TrainingError: If the folder cannot be claimed.
        FormatError: If the checkpoint of the interrupted run is damaged.
        StorageError: If the folder cannot be written.
    """
    checkpoint = out / CHECKPOINT
    if not checkpoint.exists() or (out / RESULT).exists() or not is_same(read_config(out) or {}, program, config):
        claim(out, program, config, beside)
        return None
    load(checkpoint)  # reports a damaged checkpoint before the training starts
    write_config(out, program, config, beside)
    return checkpoint


def write_config(out: Path, program: str, config: dict[str, Any], beside: dict[str, Any] | None = None) -> None:
    """Write the settings of a run into its folder; the arguments are those of `claim`.

    Raises:
        StorageError: If the file cannot be written; an earlier one then stays as it was.
    """
    write_text(out / CONFIG, text_of(program, config | (beside or {})))


def read_config(out: Path) -> dict[str, Any] | None:
    """Return the settings of the run in a folder; None if there are none.

    Raises:
        TrainingError: If the file that should hold them holds something else.
    """
    path = out / CONFIG
    if not path.is_file():
        return None
    try:
        return read_yaml(path)
    except UsageError as error:
        raise TrainingError(f"{error}; so {out} holds no training run; choose another --out") from error


def is_same(found: dict[str, Any], program: str, config: dict[str, Any]) -> bool:
    """Return whether the settings of a run are those of a program with a configuration.

    Args:
        found: Settings that `read_config` returned.
        program: Name of the command.
        config: Configuration, as plain values.
    """
    return all(found.get(key) == value for key, value in ({PROGRAM: program} | config).items())
