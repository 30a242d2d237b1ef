"""The folder of an experiment: held by one process, claimed for one recipe and one state of the datasets."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import FormatError, StorageError, TrainingError
from svfl_data.sampling.statistics import fingerprint
from svfl_data.system.side_files import read_json
from svfl_models.centering.config import TrainingConfig
from svfl_models.training import run_folder
from svfl_models.training.writing import write_json

ABOUT = "experiment.json"
RUNS = "runs"


def content(path: Path | str | None) -> dict[str, Any] | None:
    """What a dataset is at the moment: its path, number of episodes and a hash of their content.

    Raises:
        SvflError: If it cannot be read.
    """
    if path is None:
        return None
    dataset = Dataset.open(path)
    indices = dataset.indices
    return {"path": str(path), "episodes": len(indices), "sha256": fingerprint(dataset, indices)}


def describe(name: str, base: TrainingConfig, separate_test: Path | None) -> dict[str, Any]:
    """What all runs of an experiment have in common: name, recipe and the datasets' content, plain values.

    Args:
        name: Of the experiment.
        base: Configuration from which the runs deviate.
        separate_test: Dataset that every network is tested on besides.

    Raises:
        SvflError: If a dataset cannot be read.
    """
    datasets = {"data": content(base.data), "separate_test": content(separate_test)}
    return {"experiment": name, "recipe": base.plain(), **datasets}


@contextmanager
def held(out: Path) -> Iterator[None]:
    """Keep other processes out of the folder of an experiment, as long as the context lasts.

    Args:
        out: The folder; it need not exist.

    Raises:
        TrainingError: If another process works in it.
        StorageError: If it cannot be created.
    """
    with run_folder.held(out):
        try:
            (out / RUNS).mkdir(exist_ok=True)
        except OSError as error:
            raise StorageError(f"{out}: {error.strerror or error}") from error
        yield


@contextmanager
def claimed(out: Path, about: dict[str, Any]) -> Iterator[None]:
    """Hold a folder for one experiment, new or begun before, as long as the context lasts.

    Args:
        out: The folder; it need not exist.
        about: See `describe`.

    Raises:
        TrainingError: If it holds anything else, or another process works in it.
        StorageError: If it cannot be created.
    """
    _check(out, about)
    with held(out):
        if (out / ABOUT).exists():
            _check(out, about)  # somebody may have worked in it until just now
        write_json(out / ABOUT, about)
        yield


def _check(out: Path, about: dict[str, Any]) -> None:
    file = out / ABOUT
    if not file.exists():
        if out.exists() and (not out.is_dir() or any(out.iterdir())):
            raise TrainingError(f"{out} holds other files and no {ABOUT}; choose another --out")
        return
    try:
        found = read_json(file)
        changes = _changes(found, about)
    except (OSError, FormatError, AttributeError) as error:
        raise TrainingError(f"{file} does not describe an experiment ({error}); choose another --out") from error
    if changes and any(finished(run) for run in (out / RUNS).glob("*")):  # else nothing of worth is lost
        raise TrainingError(f"{out} holds runs with {'; '.join(changes)}; choose another --out or delete it")


def _changes(found: dict[str, Any], now: dict[str, Any]) -> list[str]:
    """What differs, in words."""
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
    """The numbers that a finished run left, see `report.write_report`; None if it has not finished."""
    try:
        found = read_json(folder / run_folder.RESULT)
    except (OSError, FormatError):
        return None
    return found if isinstance(found, dict) and {"config", "result"} <= found.keys() else None
