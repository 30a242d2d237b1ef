"""The folder of an experiment: one process locks it, and it belongs to one recipe and one state of the datasets."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from svfl_data.datasets.dataset import Dataset
from svfl_data.datasets.fingerprint import fingerprint
from svfl_data.errors import FormatError, StorageError, TrainingError
from svfl_data.system.side_files import read_json
from svfl_models.centering.config import TrainingConfig
from svfl_models.training import run_folder
from svfl_models.training.writing import write_json

ABOUT = "experiment.json"
RUNS = "runs"


def content(path: Path | str | None) -> dict[str, Any] | None:
    """Return the path, number of episodes and content hash of a dataset, as plain values.

    Args:
        path: Folder of the dataset. None returns None.

    Returns:
        The entries ``path``, ``episodes`` and ``sha256``.

    Raises:
        SvflError: If the dataset cannot be read.
    """
    if path is None:
        return None
    dataset = Dataset.open(path)
    indices = dataset.indices
    return {"path": str(path), "episodes": len(indices), "sha256": fingerprint(dataset, indices)}


def describe(name: str, base: TrainingConfig, separate_test: Path | None) -> dict[str, Any]:
    """Return what all runs of an experiment have in common, as plain values.

    Args:
        name: Name of the experiment.
        base: Recipe: the configuration that the runs deviate from.
        separate_test: Dataset that every network is tested on, in addition to the test split; None if there is none.

    Returns:
        The entries ``experiment`` (its name), ``recipe``, ``data`` and ``separate_test`` (see `content`).

    Raises:
        SvflError: If a dataset cannot be read.
    """
    datasets = {"data": content(base.data), "separate_test": content(separate_test)}
    return {"experiment": name, "recipe": base.plain(), **datasets}


@contextmanager
def held(out: Path) -> Iterator[None]:
    """Lock the folder of an experiment against other processes for the duration of the context.

    Args:
        out: Folder to lock, which is created if it does not exist.

    Raises:
        TrainingError: If another process works in the folder.
        StorageError: If the folder cannot be created or locked.
    """
    with run_folder.held(out):
        try:
            (out / RUNS).mkdir(exist_ok=True)
        except OSError as error:
            raise StorageError(f"{out}: {error.strerror or error}") from error
        yield


@contextmanager
def claimed(out: Path, about: dict[str, Any]) -> Iterator[None]:
    """Lock a folder for one experiment, new or begun before, and write the experiment's description into it.

    Args:
        out: Folder of the experiment, which is created if it does not exist. It is locked for the duration of the
            context.
        about: Description of the experiment, as `describe` returns it.

    Raises:
        TrainingError: If the folder holds anything else, or another process works in it.
        StorageError: If the folder cannot be created, locked or written.
    """
    _check(out, about)
    with held(out):
        if (out / ABOUT).exists():
            found = _check(out, about)  # another process may have changed the folder before it was locked
            if found.get("data") != about["data"]:
                for run in (out / RUNS).glob("*"):  # interrupted ones, which must not continue on other data
                    shutil.rmtree(run, ignore_errors=True)
        write_json(out / ABOUT, about)
        yield


def _check(out: Path, about: dict[str, Any]) -> dict[str, Any]:
    """Return the description in a folder that the experiment may use, which is empty if there is none."""
    file = out / ABOUT
    if not file.exists():
        if out.exists() and (not out.is_dir() or any(out.iterdir())):
            raise TrainingError(f"{out} holds other files and no {ABOUT}; choose another --out")
        return {}
    try:
        found: dict[str, Any] = read_json(file)
        changes = _changes(found, about)
    except (OSError, FormatError, AttributeError) as error:
        raise TrainingError(f"{file} does not describe an experiment ({error}); choose another --out") from error
    if changes and any(finished(run) for run in (out / RUNS).glob("*")):  # else no finished run is lost
        raise TrainingError(f"{out} holds runs with {'; '.join(changes)}; choose another --out or delete it")
    return found


def _changes(found: dict[str, Any], now: dict[str, Any]) -> list[str]:
    """Return the differences between two descriptions of an experiment, each in words."""
    if found.get("experiment") != now["experiment"]:
        return [f"experiment {found.get('experiment')!r}, now {now['experiment']!r}"]
    old, new = found.get("recipe", {}), now["recipe"]
    names = [*new, *(name for name in old if name not in new)]
    differ = [name for name in names if old.get(name) != new.get(name)]
    changes = [f"{name} = {old.get(name)!r}, now {new.get(name)!r}" for name in differ]
    for option in ("data", "separate_test"):
        before, after = found.get(option) or {}, now[option] or {}
        if before.get("path") != after.get("path"):
            if option not in differ:
                changes.append(f"{option} = {before.get('path')!r}, now {after.get('path')!r}")
        elif before != after:
            changes.append(
                f"an earlier content of {after['path']} ({before.get('episodes')} episodes, now {after['episodes']})"
            )
    return changes


def finished(folder: Path) -> dict[str, Any] | None:
    """Return the content of a finished run's result file, or None if the run has not finished.

    Args:
        folder: Folder of the run.

    Returns:
        At least the entries ``config`` and ``result``, see `report.write_report`.
    """
    try:
        found = read_json(folder / run_folder.RESULT)
    except (OSError, FormatError):
        return None
    return found if isinstance(found, dict) and {"config", "result"} <= found.keys() else None
