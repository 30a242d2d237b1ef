"""Collector of a trained policy's episodes on a robot that is not simulated."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from collectors.recording.collection import software_versions
from collectors.recording.loop import record, unwatched
from collectors.recording.worker import forget
from collectors.sources.connected import VERSIONS, Connected
from collectors.sources.policy import Bounded, described, loader
from collectors.tasks.task import MAX_STEPS
from svfl_data.datasets.dataset import Dataset
from svfl_data.schema.episode import Episode, Meta
from svfl_data.schema.robot import Policy, Watcher


@dataclass(frozen=True)
class RobotPolicyCollector(Connected):
    """Collector of a policy's episodes on a robot that is not simulated, where only a person can determine the success.

    Attributes:
        seed: Seed of the dataset, which changes nothing.
        task: Name of the task, which is free.
        checkpoint: File of the policy.
        robot: Name of the robot.
        steps: Number of actions after which an episode ends, unless the policy ends it before. It is not stored.
    """

    seed: int
    task: str
    checkpoint: Path
    robot: str
    steps: int = MAX_STEPS

    @cached_property
    def policy(self) -> Policy:
        """Policy of the checkpoint, loaded once in every process."""
        return loader(self.checkpoint)(self.checkpoint)

    def config(self) -> dict[str, Any]:
        """Return the configuration of the collector as JSON values, with the checkpoint's file name and SHA-256."""
        return {"task": self.task, "checkpoint": described(self.checkpoint), "robot": self.robot}

    def __call__(self, index: int, *, keep: Callable[[Episode], None] = forget, watch: Watcher = unwatched) -> Episode:
        """Bring the robot home, tare, and record one episode, which is marked as no success.

        Args:
            index: Number of the episode in the dataset.
            keep: Function for failed attempts, which is not called.
            watch: Function that is called with every observation and action.
        """
        robot = self.opened
        robot.home()
        robot.tare()
        arrays = record(robot, Bounded(self.policy, robot), self.steps, watch=watch)
        config = self.config() | {"index": index, "rejected": []}
        software = software_versions(*VERSIONS)
        meta = Meta(self.task, index, self.seed, "policy", False, config, software, robot=robot.name)
        return Episode(meta, arrays, declarations=robot.declarations)


def summary(dataset: Dataset) -> tuple[dict[str, Any], list[str]]:
    """Describe a dataset of a robot where only a person can determine the success, as facts and in a line."""
    count = len(dataset.indices)
    facts = {"path": dataset.path, "task": dataset.info["task"], "episodes": count}
    command = f"svfl-data relabel {dataset.path} --episode N --success yes"
    return facts, [f"{dataset.path}: {count} episodes; mark those that succeeded with: {command}"]
