"""The policies of a table of behaviour cloning: by task, network, number of demonstrations and seed.

Each policy is trained and evaluated once. This module is light to import, because a worker unpickles its first run
before it knows which libraries it needs.
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
"""Symmetry groups of the two networks that are compared, by name of the network."""


@dataclass(frozen=True)
class Run:
    """One policy of a table, as a `worker.Job`: how it is trained and evaluated, and its folder.

    Attributes:
        config: Configuration of the training.
        folder: Folder of the policy's checkpoint, metrics, result and evaluation.
        trials: Number of episodes that the policy is evaluated in.
    """

    config: CloningConfig
    folder: Path
    trials: int

    @property
    def task(self) -> str:
        """Name of the task, which is the name of the dataset's folder."""
        return Path(self.config.data).name

    @property
    def cost(self) -> float:
        """Relative duration of the run, which is 1 for all runs, because all take the same number of steps.

        The runs are therefore done in the order in which they are listed.
        """
        return 1.0

    def outcome(self) -> dict[str, Any] | None:
        """Return the results of training and evaluation, or None unless both are finished.

        Returns:
            The numbers of `cloning.train.Result` by name, and ``success``, which says for each trial whether it
            succeeded.

        Raises:
            TrainingError: If the folder holds a run with another configuration, finished or not.
        """
        done = finished(self.folder)
        begun = done["config"] if done else run_folder.read_config(self.folder)
        if begun is not None and not run_folder.is_same(begun | {"program": "bc"}, "bc", self.config.plain()):
            raise TrainingError(f"{self.folder} holds a run with another configuration; choose another --out")
        success = (_read(self.folder / run_folder.EVALUATION) or {}).get("success", ())
        return {**done["result"], "success": success} if done and len(success) == self.trials else None

    def words(self) -> str | None:
        """Return the success rate of the policy in words, or None unless it is trained and evaluated.

        Raises:
            TrainingError: If the folder holds a run with another configuration, finished or not.
        """
        found = self.outcome()
        return f"{sum(found['success']) / self.trials:.0%} of {self.trials}" if found else None

    def __call__(self) -> None:
        """Train and evaluate the policy, as far as that is not done yet.

        An interrupted training continues after its last whole epoch.

        Raises:
            TrainingError: If the policy cannot be trained on its data, or the training diverges. Other policies may
                still succeed.
            StorageError: If a file cannot be written.
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
    """Return every policy of a table.

    Policies with fewer demonstrations are trained for more epochs, so that all take the same number of steps. All
    policies with the first seed come first, so that an interrupted table already has results for every task.

    Args:
        base: Configuration that all policies have in common. Its number of epochs is for the largest number of
            demonstrations.
        data: Dataset folders, one for each task.
        episodes: Numbers of demonstrations to learn from.
        seeds: Number of seeds; they are 0 to `seeds` - 1.
        trials: Number of episodes that each policy is evaluated in.
        out: Folder of the table.

    Raises:
        UsageError: If several dataset folders have the same name.
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
    """Success rate of policies that differ in the seed only.

    Attributes:
        by_seed: Share of successful trials for each seed, 0..1.
        successes: Number of successful trials of all seeds together.
        trials: Number of trials of all seeds together.
    """

    by_seed: list[float]
    successes: int
    trials: int

    @classmethod
    def of(cls, outcomes: Sequence[dict[str, Any]]) -> "Rate":
        """Return the success rate of policies from their outcomes, see `Run.outcome`."""
        tried = [one["success"] for one in outcomes]
        return cls([sum(one) / len(one) for one in tried], sum(map(sum, tried)), sum(map(len, tried)))

    @property
    def share(self) -> float:
        """Share of all trials that were successful, 0..1."""
        return self.successes / self.trials

    @property
    def interval(self) -> tuple[float, float]:
        """Bounds of the 95 % confidence interval of `share`, 0..1, for newly drawn scenes.

        The interval does not include the differences between seeds.
        """
        from svfl_data.reports.success_rate import wilson

        return wilson(self.successes, self.trials)
