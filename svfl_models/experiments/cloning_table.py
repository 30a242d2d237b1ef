"""The policies of a table of behaviour cloning: by task, network, number of demonstrations and seed.

Each policy is trained and evaluated once. This module is light to import, because a worker unpickles its first run
before it is determined which libraries it needs.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from svfl_data.errors import FormatError, StorageError, SvflError, TrainingError, UsageError
from svfl_data.system.side_files import read_json
from svfl_models.cloning.config import NETWORKS, CloningConfig
from svfl_models.experiments.runs.folder import RUNS, finished
from svfl_models.training import run_folder


@dataclass(frozen=True)
class Run:
    """One policy of a table, as a `worker.Job`: how it is trained and evaluated, and its folder.

    Attributes:
        config: Configuration of the training.
        folder: Folder of the policy's checkpoint, metrics, result and evaluation.
        test_episodes: Number of episodes that the policy is evaluated in.
    """

    config: CloningConfig
    folder: Path
    test_episodes: int

    @property
    def task(self) -> str:
        """Name of the task, which is the name of the dataset's folder."""
        return Path(self.config.data).name

    @property
    def network(self) -> str:
        """Name of the network, a key of `cloning.config.NETWORKS`."""
        return next(name for name, settings in NETWORKS.items() if replace(self.config, **settings) == self.config)

    @property
    def cost(self) -> float:
        """Relative duration of the run, which is 1 for all runs, because all take the same number of steps.

        The runs are therefore done in the order in which they are listed.
        """
        return 1.0

    def outcome(self) -> dict[str, Any] | None:
        """Return the results of training and evaluation, or None unless both are finished.

        Returns:
            The numbers of `cloning.train.Result` by name, and ``success``, which says for each test episode whether it
            succeeded.

        Raises:
            TrainingError: If the folder holds a run with another configuration, finished or not.
        """
        done = finished(self.folder)
        begun = done["config"] if done else run_folder.read_config(self.folder)
        if begun is not None and not run_folder.is_same(begun | {"program": "bc"}, "bc", self.config.plain()):
            raise TrainingError(f"{self.folder} holds a run with another configuration; choose another --out")
        success = (_read(self.folder / run_folder.EVALUATION) or {}).get("success", ())
        return {**done["result"], "success": success} if done and len(success) == self.test_episodes else None

    def words(self) -> str | None:
        """Return the success rate of the policy in words, or None unless it is trained and evaluated.

        Raises:
            TrainingError: If the folder holds a run with another configuration, finished or not.
        """
        found = self.outcome()
        return f"{sum(found['success']) / self.test_episodes:.0%} of {self.test_episodes}" if found else None

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
            evaluation = evaluate(self.folder / run_folder.CHECKPOINT, self.test_episodes, console=quiet)
            evaluation.save(self.folder / run_folder.EVALUATION)
        except StorageError:
            raise
        except SvflError as error:
            raise TrainingError(str(error)) from error


def runs(
    base: CloningConfig,
    data: Sequence[str],
    episodes: Sequence[int],
    seeds: int,
    test_episodes: int,
    out: Path,
    networks: Sequence[str] = tuple(NETWORKS),
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
        test_episodes: Number of episodes that each policy is evaluated in.
        out: Folder of the table.
        networks: Names of the networks to compare, keys of `cloning.config.NETWORKS`.

    Raises:
        UsageError: If several dataset folders have the same name.
    """
    tasks = [Path(folder).name for folder in data]
    if twice := sorted({task for task in tasks if tasks.count(task) > 1}):
        raise UsageError(
            f"--data has several folders called {', '.join(twice)}; a table identifies tasks by their names"
        )
    found = []
    for seed in range(seeds):
        for folder in data:
            for count in episodes:
                for network in networks:
                    epochs = base.epochs * max(episodes) // count
                    one = replace(base, data=folder, seed=seed, episodes=count, epochs=epochs)
                    config = replace(one, **NETWORKS[network])
                    name = f"{Path(folder).name}_{base.encoder}_{network}_{count}_seed{seed}"
                    found.append(Run(config, out / RUNS / name, test_episodes))
    return found


class Table:
    """The runs of a table, looked up by task, number of demonstrations and network.

    Args:
        runs: All runs of the table, finished or not, with the same number of test episodes each.

    Attributes:
        runs: All runs of the table.
        test_episodes: Number of episodes that each policy is evaluated in.
        tasks: Names of the tasks, in the order of the runs.
        counts: Numbers of demonstrations, in increasing order.
        networks: Names of the networks, in the order of `NETWORKS`.
        seeds: Number of seeds that the table is to have.
    """

    def __init__(self, runs: Sequence[Run]) -> None:
        self.runs, self.test_episodes = list(runs), runs[0].test_episodes
        self.tasks = list(dict.fromkeys(run.task for run in runs))
        self.counts = sorted({run.config.episodes for run in runs})
        self.networks = [name for name in NETWORKS if any(run.network == name for run in runs)]
        self.seeds = len({run.config.seed for run in runs})
        self._outcomes = {run.folder: run.outcome() for run in runs}

    def find(self, task: str, count: int, network: str) -> list[tuple[Run, dict[str, Any]]]:
        """Return the finished runs of all seeds, each with its outcome.

        Args:
            task: Name of the task.
            count: Number of demonstrations.
            network: Name of the network, one of `networks`.
        """
        wanted = [run for run in self.runs if (run.task, run.config.episodes, run.network) == (task, count, network)]
        return [(run, outcome) for run in wanted if (outcome := self._outcomes[run.folder])]

    def success(self, task: str, count: int, network: str) -> np.ndarray | None:
        """Return the outcome of each test episode, shape (finished seeds, episodes), or None if no seed is finished.

        Args:
            task: Name of the task.
            count: Number of demonstrations.
            network: Name of the network, one of `networks`.
        """
        found = [outcome["success"] for _, outcome in self.find(task, count, network)]
        return np.array(found, dtype=float) if found else None

    @property
    def done(self) -> list[dict[str, Any]]:
        """Outcomes of all finished runs."""
        return [outcome for outcome in self._outcomes.values() if outcome]


def _read(file: Path) -> dict[str, Any] | None:
    try:
        found = read_json(file)
    except (OSError, FormatError):
        return None
    return found if isinstance(found, dict) else None
