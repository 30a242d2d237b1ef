"""Many training runs, side by side, each of them once."""

import os
import shutil
from collections import deque
from collections.abc import Mapping
from multiprocessing import connection
from pathlib import Path

from rich.console import Console

from svfl_data.errors import TrainingError
from svfl_models.config import TrainingConfig
from svfl_models.experiments.bar import Bar
from svfl_models.experiments.cost import cost
from svfl_models.experiments.folder import RUNS, finished
from svfl_models.experiments.worker import Train, Worker, devices, train

LOG = "workers.log"


def run_name(config: TrainingConfig, base: TrainingConfig) -> str:
    """Name of a run within its experiment, for people and for its folder: what it deviates in, and the seed."""
    if config.latent:  # its name tells the rest
        return f"{config.latent}_{config.train_samples}_seed{config.seed}"
    usual = ("encoder", "group", "train_samples", "seed")
    others = [name for name, value in config.plain().items() if name not in usual and value != getattr(base, name)]
    special = [f"{name}-{getattr(config, name)}" for name in others]
    return "_".join([config.encoder, config.group, str(config.train_samples), *special, f"seed{config.seed}"])


class Grid:
    """Runs of an experiment in its folder.

    Args:
        out: Folder of the experiment, held by this process (`folder.claimed`).
        runs: Configurations by name.
        fresh: Dataset that every network is tested on besides.
        train: Trains one network; another one in tests.

    Attributes:
        failed: Why runs failed, by name, in this process.
    """

    def __init__(
        self,
        out: Path,
        runs: Mapping[str, TrainingConfig],
        fresh: Path | None = None,
        train: Train = train,
    ) -> None:
        self.out, self.runs, self.fresh, self.train = out, runs, fresh, train
        self.failed: dict[str, str] = {}

    def folder(self, name: str) -> Path:
        """Folder of a run."""
        return self.out / RUNS / name

    def unfinished(self) -> list[str]:
        """Names of the runs that are still to be done, the longest first: so no core waits for a long one at the end.

        Raises:
            TrainingError: If a finished run of that name had another configuration.
        """
        names = []
        for name, config in self.runs.items():
            found = finished(self.folder(name))
            if found is None:
                names.append(name)
            elif found["config"] != config.plain():
                raise TrainingError(f"{self.folder(name)} holds a run with another configuration; choose another --out")
        return sorted(names, key=lambda name: cost(self.runs[name]), reverse=True)

    def run(self, workers: int, console: Console) -> None:
        """Do what is unfinished; a run that fails is noted in `failed`, and the others go on.

        Args:
            workers: Processes. On a machine with GPUs, they take turns in getting one.
            console: Where progress goes.

        Raises:
            SvflError: If what has happened would happen to every run, such as a full disk.
            KeyboardInterrupt: If the user stopped it; finished runs are kept.
        """
        waiting = deque(self.unfinished())
        if not waiting:
            return
        os.environ.setdefault("OMP_NUM_THREADS", "1")  # workers inherit it: one core each
        names, log = devices(), self.out / LOG
        crew: dict[int, Worker] = {}
        try:
            with Bar(self.runs, waiting, console) as bar:
                while waiting or any(one.name for one in crew.values()):
                    for place in range(workers):
                        if waiting and place not in crew:
                            crew[place] = Worker(self.train, self.fresh, names[place % len(names)], log)
                        if waiting and crew[place].name is None:
                            self._begin(crew[place], waiting.popleft())
                    busy = {one.connection: place for place, one in crew.items() if one.name}
                    for ready in connection.wait(list(busy)):
                        name, words = self._end(crew, busy[ready])  # type: ignore[index] # what was given comes back
                        bar.ended(name, words)
        finally:
            for one in crew.values():
                one.end()

    def _begin(self, worker: Worker, name: str) -> None:
        if self.folder(name).exists():
            shutil.rmtree(self.folder(name))  # of a run that was stopped or failed
        worker.begin(name, self.runs[name], self.folder(name))

    def _end(self, crew: dict[int, Worker], place: int) -> tuple[str, str]:
        """Note how a run ended; returns its name and that in words. A worker that died leaves its place."""
        name = str(crew[place].name)
        try:
            error = crew[place].outcome()
        except EOFError:
            dead = crew.pop(place)
            error = TrainingError(f"its process died with exit code {dead.exit_code()}, see {self.out / LOG}")
            dead.end()
        if error is None:
            found = finished(self.folder(name))
            return name, f"test accuracy {found['result']['test_accuracy']:.1%}" if found else "no result"
        if not isinstance(error, TrainingError):
            raise error
        self.failed[name] = str(error)
        return name, "failed"
