"""Collector of a trained policy's episodes, which are all kept, whether they succeed or not.

This package loads no policies itself. A package that can load some kind of policy file declares a function
``load(path) -> policy`` in the entry-point group ``svfl.policies``, under the file's suffix without its dot.
"""

import hashlib
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from functools import cached_property
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from collectors.recording.collection import software_versions
from collectors.recording.loop import forget_past, record, unwatched
from collectors.recording.worker import forget
from collectors.simulation.config import WorldConfig
from collectors.sources.simulated import VERSIONS, Simulated
from collectors.tasks import task_class
from collectors.tasks.task import MAX_STEPS, POLICY_ATTEMPT, attempt_seed
from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import FormatError, UsageError
from svfl_data.reports.success_rate import wilson
from svfl_data.schema.episode import Episode, Meta
from svfl_data.schema.robot import Observation, Policy, Robot, Watcher
from svfl_data.system.regular_file import open_regular

GROUP = "svfl.policies"


def loader(checkpoint: Path) -> Callable[[Path], Policy]:
    """Return the function that loads policy files of a checkpoint's kind.

    Args:
        checkpoint: File of the policy, whose suffix says its kind.

    Raises:
        UsageError: If no installed package has a function for that suffix.
        FormatError: If the checkpoint does not exist.
    """
    known: dict[str, EntryPoint] = {entry.name: entry for entry in entry_points(group=GROUP)}
    entry = known.get(checkpoint.suffix.removeprefix("."))
    if entry is None:
        kinds = ", ".join(f".{name}" for name in sorted(known)) or "none (svfl must be installed with pip)"
        raise UsageError(f"{checkpoint}: no installed package loads this kind of policy; possible: {kinds}")
    if not checkpoint.exists():
        raise FormatError(f"{checkpoint}: no such file")
    load: Callable[[Path], Policy] = entry.load()
    return load


@dataclass(frozen=True)
class PolicyCollector(Simulated):
    """Collector that produces a policy's episode of an index, in a scene that no demonstration of the same seed has.

    Attributes:
        seed: Seed of the dataset.
        task: Name of the task, one of `collectors.TASKS`.
        checkpoint: File of the policy.
        world: Configuration of the world: physics, arm, sensors and cameras. The policy takes the images of
            the camera that it was trained with.
    """

    seed: int
    task: str
    checkpoint: Path
    world: WorldConfig = field(default_factory=WorldConfig)

    @cached_property
    def policy(self) -> Policy:
        """Policy of the checkpoint, loaded once in every process."""
        return loader(self.checkpoint)(self.checkpoint)

    def config(self) -> dict[str, Any]:
        """Return the configuration of the collector as JSON values, with the checkpoint's file name and SHA-256."""
        return {"task": self.task, "checkpoint": described(self.checkpoint), "world": asdict(self.world)}

    def __call__(self, index: int, *, keep: Callable[[Episode], None] = forget, watch: Watcher = unwatched) -> Episode:
        """Record one episode. There is one attempt, whether or not it succeeds.

        Args:
            index: Number of the episode in the dataset.
            keep: Function for failed attempts, which is not called.
            watch: Function that is called with every observation and action.
        """
        task = task_class(self.task).begin(self.opened, attempt_seed(self.seed, index, POLICY_ATTEMPT))
        arrays = record(self.opened, Bounded(self.policy, self.opened), MAX_STEPS, task.success, task.state, watch)
        facts = {"drawn": task.drawn(), "index": index, "attempt": POLICY_ATTEMPT, "rejected": []}
        software = software_versions(*VERSIONS)
        meta = Meta(
            self.task, index, self.seed, "policy", task.success(), self.config() | facts, software,
            robot=self.opened.name,
        )  # fmt: skip
        return Episode(meta, arrays, declarations=self.opened.declarations)


def described(checkpoint: Path) -> dict[str, str]:
    """Return file name and SHA-256 of a checkpoint."""
    with open(open_regular(checkpoint.resolve()), "rb") as file:
        return {"name": checkpoint.name, "sha256": hashlib.file_digest(file, "sha256").hexdigest()}


class Bounded:
    """A policy whose actions are clipped to a robot's bounds, so that what is recorded is what is carried out."""

    def __init__(self, policy: Policy, robot: Robot) -> None:
        """Take the bounds of a robot.

        Args:
            policy: Any policy.
            robot: Robot whose declared bounds are taken. The actions of a robot without bounds stay as they are.
        """
        self._policy, self._bounds = policy, robot.action.bounds

    def forget(self) -> None:
        """Forget the past, because another episode begins."""
        forget_past(self._policy)

    def __call__(self, observation: Observation) -> NDArray[np.float32] | None:
        """Return the action for an observation, shape (A,), within the bounds; None to end the episode.

        Args:
            observation: Observation of the current step.
        """
        action = self._policy(observation)
        bounds = self._bounds
        if action is None or not bounds or len(action) != len(bounds):  # the recording loop refuses another length
            return action
        low, high = np.transpose(bounds)
        return np.clip(action, low, high).astype(np.float32)


def summary(dataset: Dataset) -> str:
    """Describe in a line of text the success rate over all episodes of a dataset, with its 95 % interval."""
    successes = [dataset.episode(index).meta.success for index in dataset.indices]
    low, high = wilson(sum(successes), len(successes))
    return (
        f"{dataset.path}: {sum(successes)} of {len(successes)} episodes succeeded, {np.mean(successes):.1%} "
        f"(95 % interval {low:.1%} to {high:.1%})"
    )
