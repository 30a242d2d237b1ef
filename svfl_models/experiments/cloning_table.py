"""Many clonings side by side: tasks, networks, numbers of demonstrations and seeds, each trained and tried once.

Light to import, for a worker unpickles its first run before it knows what it needs.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from svfl_data.errors import FormatError, StorageError, SvflError, TrainingError, UsageError
from svfl_data.system.side_files import read_json
from svfl_models.cloning.config import CloningConfig
from svfl_models.experiments.runs.folder import RUNS, finished
from svfl_models.training import run_folder

GROUPS = {"svfl": "D4", "cnn": "none"}
"""The two networks that are compared -> group."""


@dataclass(frozen=True)
class Run:
    """One policy: how it is trained and tried, and where it lies; a `worker.Job`.

    Attributes:
        config: Of its training.
        folder: Of its checkpoint, metrics, result and evaluation.
        trials: Episodes that it is tried in.
    """

    config: CloningConfig
    folder: Path
    trials: int

    @property
    def task(self) -> str:
        """Name of its dataset's folder."""
        return Path(self.config.data).name

    @property
    def cost(self) -> float:
        """The same for all, since all take as many steps: they are done in their order."""
        return 1.0

    def outcome(self) -> dict[str, Any] | None:
        """What its training and its evaluation found; None unless both are done.

        Raises:
            TrainingError: If its folder holds a run with another configuration, finished or not.
        """
        done = finished(self.folder)
        begun = done["config"] if done else _read(self.folder / run_folder.CONFIG)
        if begun not in (None, self.config.plain()):
            raise TrainingError(f"{self.folder} holds a run with another configuration; choose another --out")
        success = (_read(self.folder / run_folder.EVALUATION) or {}).get("success", ())
        return {**done["result"], "success": success} if done and len(success) == self.trials else None

    def words(self) -> str | None:
        """How often it succeeded; None unless it is trained and tried."""
        found = self.outcome()
        return f"{sum(found['success']) / self.trials:.0%} of {self.trials}" if found else None

    def __call__(self) -> None:
        """Do what is left: an interrupted training goes on after its last whole epoch.

        Raises:
            TrainingError: If its data cannot serve, which may serve other policies, or its training diverges.
            StorageError: If the disk refuses.
        """
        import torch
        from rich.console import Console

        from svfl_models.cloning.evaluate import evaluate
        from svfl_models.cloning.train import train_cloning

        torch.set_num_threads(1)
        quiet = Console(quiet=True)
        try:
            if finished(self.folder) is None:
                train_cloning(self.config, self.folder, quiet)
            evaluation = evaluate(self.folder / run_folder.CHECKPOINT, self.trials, console=quiet)
            evaluation.save(self.folder / run_folder.EVALUATION)
        except StorageError:
            raise
        except SvflError as error:
            raise TrainingError(str(error)) from error


def runs(
    base: CloningConfig, data: Sequence[str], episodes: Sequence[int], seeds: int, trials: int, out: Path
) -> list[Run]:
    """Every policy of a table; those of fewer demonstrations train for more epochs, so that all take as many steps.

    All first seeds come first, so that a table that was stopped shows something of everything.

    Args:
        base: What all have in common; its epochs are those of the largest number of demonstrations.
        data: Dataset folders, one for each task.
        episodes: Numbers of demonstrations.
        seeds: 0 to this number, exclusive.
        trials: Episodes that each policy is tried in.
        out: Folder of the table.

    Raises:
        UsageError: If datasets have the same name.
    """
    tasks = [Path(folder).name for folder in data]
    if twice := sorted({task for task in tasks if tasks.count(task) > 1}):
        raise UsageError(f"--data has several folders called {', '.join(twice)}; a table tells tasks by their names")
    configs = [
        replace(base, data=folder, episodes=count, epochs=base.epochs * max(episodes) // count, group=group, seed=seed)
        for seed in range(seeds)
        for folder in data
        for count in episodes
        for group in GROUPS.values()
    ]
    names = [f"{Path(one.data).name}_{one.encoder}_{one.model}_{one.episodes}_seed{one.seed}" for one in configs]
    return [Run(config, out / RUNS / name, trials) for config, name in zip(configs, names, strict=True)]


def _read(file: Path) -> dict[str, Any] | None:
    try:
        found = read_json(file)
    except (OSError, FormatError):
        return None
    return found if isinstance(found, dict) else None


@dataclass(frozen=True)
class Rate:
    """How often policies of several seeds succeeded.

    Attributes:
        by_seed: Share of each, 0..1.
        successes: Of all together.
        trials: Of all together.
    """

    by_seed: list[float]
    successes: int
    trials: int

    @classmethod
    def of(cls, outcomes: Sequence[dict[str, Any]]) -> "Rate":
        """From the outcomes of the seeds."""
        tried = [one["success"] for one in outcomes]
        return cls([sum(one) / len(one) for one in tried], sum(map(sum, tried)), sum(map(len, tried)))

    @property
    def share(self) -> float:
        """Of all trials, 0..1."""
        return self.successes / self.trials

    @property
    def interval(self) -> tuple[float, float]:
        """Of `share`, 95 %, for scenes drawn anew; seeds' differences are not in it."""
        from svfl_data.reports.success_rate import wilson

        return wilson(self.successes, self.trials)
