"""Provenance of experiments: each start is recorded in the folder, and the page shows it and that of the runs."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from svfl_models.training.provenance.record import of_runs, record
from svfl_models.training.provenance.session import DataRecord, Session, dataset, session
from svfl_models.training.provenance.words import section


def experiment_started(out: Path, about: Mapping[str, Any], seeds: int) -> Session:
    """Record this start of a block-centering experiment in its folder, and return it.

    Args:
        out: Folder of the experiment, locked by this process.
        about: Description of the experiment, as `folder.describe` returns it.
        seeds: Number of seeds.

    Raises:
        FormatError: If the file of the earlier starts is damaged.
        StorageError: If the file cannot be written.
    """
    known = {"data": about["data"], "separate-test": about["separate_test"]}
    data = {name: DataRecord(**one) for name, one in known.items() if one}
    return record(out, session(data, range(seeds), device=""))[-1]


def table_started(out: Path, runs: Iterable[Any]) -> Session:
    """Record this start of a table of behaviour cloning in its folder, and return it.

    Args:
        out: Folder of the table, locked by this process.
        runs: Runs of the table (`cloning_table.Run`).

    Raises:
        FormatError: If the file of the earlier starts is damaged.
        StorageError: If the file cannot be written.
    """
    listed = list(runs)
    data = {task: dataset(path) for task, path in {run.task: run.config.data for run in listed}.items()}
    return record(out, session(data, sorted({run.config.seed for run in listed}), device=""))[-1]


def runs_section(started: Session, folders: Iterable[Path]) -> str:
    """Return the section of a page on its provenance and that of the finished runs, in Markdown.

    Args:
        started: Provenance of the page.
        folders: Folders of the finished runs.
    """
    return section(started, of_runs(folders))
