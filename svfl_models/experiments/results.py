"""Results of an experiment: runs of equal configuration form cells, with mean and standard error over the seeds."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from svfl_models.centering.config import TrainingConfig
from svfl_models.experiments.runs.folder import finished
from svfl_models.training.writing import write_rows

NOTHING = "-"
TEST_SPLIT, SEPARATE_TEST_SET = "test split", "separate test set"
VARIED = ("encoder", "group", "train_samples", "torque", "view", "image_size", "augment", "rotate", "noise")
"""Settings that an experiment may vary; the other settings of a configuration are the recipe."""
RESULTS = ("test_accuracy", "best_test_accuracy", "separate_test_accuracy", "epochs", "seconds", "parameters")


@dataclass(frozen=True)
class Run:
    """One training run of an experiment.

    Attributes:
        name: Name of the run within its experiment.
        config: Configuration of the training.
        folder: Folder of the run.
        result: Numbers of the run by name, see `report.Result`; None if the run has not finished.
    """

    name: str
    config: TrainingConfig
    folder: Path
    result: dict[str, Any] | None


@dataclass(frozen=True)
class Mean:
    """Mean of a few measurements.

    Attributes:
        mean: Arithmetic mean of the measurements.
        error: Standard error of the mean: sample standard deviation / sqrt(count); None for a single measurement.
        count: Number of measurements.
    """

    mean: float
    error: float | None
    count: int

    @classmethod
    def of(cls, values: Sequence[float]) -> "Mean | None":
        """Return the mean of measurements, or None if there are no measurements."""
        if not values:
            return None
        count = len(values)
        mean = math.fsum(values) / count
        if count == 1:
            return cls(mean, None, 1)
        variance = math.fsum((value - mean) ** 2 for value in values) / (count - 1)
        return cls(mean, math.sqrt(variance / count), count)

    def __str__(self) -> str:
        return f"{self.mean:.1f}" + (f" +- {self.error:.1f}" if self.error is not None else "")


@dataclass(frozen=True)
class Cell:
    """Runs that differ in nothing but the seed.

    Attributes:
        config: Configuration of the runs, with seed 0.
        runs: The runs, finished or not.
    """

    config: TrainingConfig
    runs: tuple[Run, ...]

    def mean(self, name: str, factor: float = 1.0) -> Mean | None:
        """Return the mean of a result over the finished runs, or None if no run has this result.

        Args:
            name: Name of the result, such as one of `RESULTS`.
            factor: Factor that each value is multiplied by.
        """
        values = [run.result[name] for run in self.runs if run.result]
        return Mean.of([factor * value for value in values if value is not None])

    @property
    def test(self) -> Mean | None:
        """Mean accuracy on the test split, [%]; None if no run has finished."""
        return self.mean("test_accuracy", 100)

    @property
    def separate(self) -> Mean | None:
        """Mean accuracy on the separate test set, [%]; None if no finished run was tested on one."""
        return self.mean("separate_test_accuracy", 100)

    def on(self, test: str) -> Mean | None:
        """Return the mean accuracy on a test set, `TEST_SPLIT` or `SEPARATE_TEST_SET`, [%]; None if there is none."""
        return self.test if test == TEST_SPLIT else self.separate

    @property
    def seconds(self) -> Mean | None:
        """Mean time of a training, [s]; None if no run has finished."""
        return self.mean("seconds")

    def words(self, mean: Mean | None) -> str:
        """Return a mean of this cell in words for a table, with the number of seeds if runs are missing."""
        if mean is None:
            return NOTHING
        return str(mean) if mean.count == len(self.runs) else f"{mean} ({mean.count} of {len(self.runs)} seeds)"


class Results:
    """The runs of an experiment, looked up by configuration.

    Args:
        configs: Configurations of the runs by their names.
        folder: Folder that holds a folder for each run, under the name of the run.

    Attributes:
        runs: All runs, finished or not, in the order of `configs`.
    """

    def __init__(self, configs: Mapping[str, TrainingConfig], folder: Path) -> None:
        self.runs: list[Run] = []
        for name, config in configs.items():
            found = finished(folder / name)
            self.runs.append(Run(name, config, folder / name, found["result"] if found else None))
        together: dict[TrainingConfig, list[Run]] = {}
        for run in self.runs:
            together.setdefault(replace(run.config, seed=0), []).append(run)
        self._cells = {config: Cell(config, tuple(runs)) for config, runs in together.items()}

    @property
    def cells(self) -> list[Cell]:
        """All cells, in the order of the runs."""
        return list(self._cells.values())

    def find(self, **settings: object) -> list[Cell]:
        """Return the cells whose configuration has given values, in the order of the runs.

        Args:
            settings: Values by names of settings, such as ``encoder="f"``.
        """
        return [
            cell for cell in self.cells if all(getattr(cell.config, name) == value for name, value in settings.items())
        ]

    def values(self, setting: str) -> list[Any]:
        """Return the different values that a setting has in the experiment, in the order of the runs."""
        found: list[Any] = []
        for value in (getattr(cell.config, setting) for cell in self.cells):
            if value not in found:  # some values, such as those of widths, have no hash
                found.append(value)
        return found

    @property
    def tested_separately(self) -> bool:
        """Whether any run was tested on a separate test set."""
        return any(cell.separate for cell in self.cells)

    def seconds(self) -> float:
        """Return the training time of all finished runs together, [s]."""
        return math.fsum(run.result["seconds"] for run in self.runs if run.result)

    def write_runs(self, path: Path) -> None:
        """Write a CSV file with one row per run.

        Accuracies are 0..1. The results of runs that have not finished are left empty.

        Args:
            path: File to write.
        """
        rows: list[list[object]] = [["run", *self._columns(), "seed", *RESULTS]]
        for run in self.runs:
            numbers = [run.result.get(name, "") for name in RESULTS] if run.result else [""] * len(RESULTS)
            rows.append([run.name, *self._settings(run.config), run.config.seed, *numbers])
        write_rows(path, rows)

    def write_summary(self, path: Path) -> None:
        """Write a CSV file with one row per cell: means over the seeds, and standard errors of the accuracies.

        Accuracies are in per cent, times in [s].

        Args:
            path: File to write.
        """
        names = ("test", "test_error", "separate_test", "separate_test_error", "seconds", "parameters")
        rows: list[list[object]] = [[*self._columns(), "seeds", *names]]
        for cell in self.cells:
            numbers = [*_pair(cell.test), *_pair(cell.separate), _pair(cell.seconds)[0]]
            parameters = cell.mean("parameters")
            seeds = cell.test.count if cell.test else 0
            rows.append([*self._settings(cell.config), seeds, *numbers, round(parameters.mean) if parameters else ""])
        write_rows(path, rows)

    def _columns(self) -> list[str]:
        latent = ["latent"] if any(run.config.latent for run in self.runs) else []
        return [*VARIED, "preset", *latent]

    def _settings(self, config: TrainingConfig) -> list[object]:
        return [getattr(config, name) or "" if name == "latent" else getattr(config, name) for name in self._columns()]


def _pair(mean: Mean | None) -> tuple[str, str]:
    if mean is None:
        return "", ""
    return f"{mean.mean:.2f}", "" if mean.error is None else f"{mean.error:.2f}"
