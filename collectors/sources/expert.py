"""Collector of demonstrations: a scripted expert makes attempts until an attempt succeeds."""

from collections import Counter
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from collectors.recording.collection import software_versions
from collectors.recording.loop import record, unwatched
from collectors.recording.worker import forget
from collectors.simulation.config import WorldConfig
from collectors.sources.perturbations import Perturbed
from collectors.sources.simulated import VERSIONS, Simulated
from collectors.tasks import task_class
from collectors.tasks.gripper import Gripper
from collectors.tasks.task import ATTEMPTS, MAX_STEPS, Task, attempt_seed
from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import CollectError
from svfl_data.sampling.samples import EXPERT_ACTION
from svfl_data.schema.action_fields import expert
from svfl_data.schema.episode import Episode, Meta
from svfl_data.schema.robot import Policy, Watcher


@dataclass(frozen=True)
class ExpertCollector(Simulated):
    """Collector that produces the demonstration of an index.

    The same arguments give the same bytes in any process. Failed attempts are counted, and can be kept.

    Attributes:
        seed: Seed of the dataset.
        task: Name of the task, one of `collectors.TASKS`.
        noise: Amount by which demonstrations differ: 0 not at all, 1 as intended, 2 at most.
        perturbations: Probability, 0..1, that a perturbation of the gripper begins at an action (see
            `collectors.sources.perturbations`).
        world: Configuration of the world: physics, arm, sensors and cameras.
        attempts: Number of attempts after which the collector gives up, 20 at most. It is not stored, because it
            changes no episode.
        steps: Number of actions after which an attempt ends. It is not stored either: a replay takes the recorded
            actions.
    """

    seed: int
    task: str
    noise: float = 1.0
    perturbations: float = 0.0
    world: WorldConfig = field(default_factory=WorldConfig)
    attempts: int = ATTEMPTS
    steps: int = MAX_STEPS

    def config(self) -> dict[str, Any]:
        """Return the configuration of the collector as JSON values."""
        return {
            "task": self.task, "noise": self.noise, "perturbations": self.perturbations, "world": asdict(self.world),
        }  # fmt: skip

    def __call__(self, index: int, *, keep: Callable[[Episode], None] = forget, watch: Watcher = unwatched) -> Episode:
        """Record one demonstration.

        Args:
            index: Number of the episode in the dataset.
            keep: Function that is called with every failed attempt, as an episode. The number of that episode is
                `index` times 20 plus the number of the attempt.
            watch: Function that is called with every observation and action of every attempt.

        Returns:
            The episode of the first attempt that succeeds.

        Raises:
            CollectError: If no attempt succeeds.
        """
        rejected: list[str] = []
        for attempt in range(self.attempts):
            episode = self._attempt(index, attempt, list(rejected), watch)
            if episode.meta.success:
                return episode
            keep(episode)
            early = len(episode) < self.steps
            rejected.append("the expert gave up" if early else f"not achieved in {self.steps} steps")
        raise CollectError(
            f"episode {index} of {self.task} (seed {self.seed}): none of {self.attempts} attempts succeeded: "
            + _counted(Counter(rejected))
        )

    def _attempt(self, index: int, attempt: int, rejected: list[str], watch: Watcher) -> Episode:
        seed = attempt_seed(self.seed, index, attempt)
        task = task_class(self.task).begin(self.opened, seed)
        # The generators are children of the seed, so that the expert's noise and the perturbations are independent of
        # the scene's numbers.
        rng, perturbations = (
            np.random.default_rng(np.random.SeedSequence(seed.entropy, spawn_key=(child,))) for child in range(2)
        )
        moves = task.expert(Gripper(self.opened, rng, self.noise))
        policy = Perturbed(moves, self.opened.action_bound, self.perturbations, perturbations)
        arrays, success = self._recorded(task, policy, watch)
        if self.perturbations:
            arrays[EXPERT_ACTION] = np.array(policy.expert_action, np.float32).reshape(-1, 5)
        facts = {"drawn": task.drawn(), "index": index, "attempt": attempt, "rejected": rejected}
        number = index if success else index * ATTEMPTS + attempt
        meta = Meta(
            self.task, number, self.seed, "expert", success, self.config() | facts, software_versions(*VERSIONS),
            robot=self.opened.name,
        )  # fmt: skip
        return Episode(meta, arrays, declarations=self.opened.declarations.with_own([expert(self.opened.action)]))

    def _recorded(self, task: Task, policy: Policy, watch: Watcher) -> tuple[dict[str, np.ndarray], bool]:
        """Run a policy on a task that has just been set up; return its arrays and whether the task is achieved."""
        return record(self.opened, policy, self.steps, task.success, task.state, watch), task.success()


def summary(dataset: Dataset) -> tuple[dict[str, Any], list[str]]:
    """Describe a dataset of demonstrations, as facts and in a line: its size, and how many attempts failed and why."""
    rejected: Counter[str] = Counter()
    steps = []
    for index in dataset.indices:
        episode = dataset.episode(index)
        steps.append(len(episode))
        rejected.update(episode.meta.config["rejected"])
    attempts = len(steps) + rejected.total()
    median = float(np.median(steps))
    words = f"{dataset.path}: {len(steps)} demonstrations of {median:.0f} steps (median)"
    failed = f", {rejected.total()} of {attempts} attempts failed"
    facts = {"path": dataset.path, "task": dataset.info["task"], "episodes": len(steps), "median_steps": median}
    facts |= {"attempts": attempts, "failures": dict(rejected)}
    return facts, [words + failed + (f": {_counted(rejected)}" if rejected else "")]


def _counted(reasons: Counter[str]) -> str:
    return ", ".join(f"{count} x {reason}" for reason, count in reasons.most_common())
