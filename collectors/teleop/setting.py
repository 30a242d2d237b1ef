"""Settings of teleoperated episodes: the robot, and how an episode on it begins and is known to be achieved."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, ClassVar, Protocol

from collectors.recording.loop import State
from collectors.simulation.config import WorldConfig
from collectors.sources import connected, simulated
from collectors.sources.connected import Connected
from collectors.sources.simulated import Simulated
from collectors.tasks import task_class
from collectors.tasks.task import POLICY_ATTEMPT, attempt_seed
from svfl_data.schema.robot import Robot

ATTEMPT = POLICY_ATTEMPT + 1
"""Attempt number of every teleoperated episode, whose scene is therefore one that no expert and no policy has."""


@dataclass(frozen=True)
class Begun:
    """Episode that is set up, with the gripper at home.

    Attributes:
        opened: Whether the gripper is open, rather than holding something.
        facts: Facts about the episode that its configuration keeps, JSON values.
        success: Function that returns whether the task is achieved. Never by default, since it is known only in a
            simulation.
        state: Function that returns true values to record, as for `collectors.recording.loop.record`.
    """

    opened: bool
    facts: dict[str, Any]
    success: Callable[[], bool] = lambda: False
    state: Callable[[], State] = dict


class Setting(Protocol):
    """Settings that a dataset of teleoperated episodes is recorded with."""

    @property
    def seed(self) -> int:
        """Seed of the dataset."""

    @property
    def task(self) -> str:
        """Name of the task."""

    @property
    def versions(self) -> Sequence[str]:
        """Packages whose versions every episode stores."""

    @property
    def opened(self) -> Robot:
        """The robot, connected."""

    def config(self) -> dict[str, Any]:
        """Return all settings except the seed, as JSON values."""

    def begin(self, index: int) -> Begun:
        """Set up the episode of an index, and tare.

        Args:
            index: Number of the episode in the dataset.
        """

    def close(self) -> None:
        """Close what is open."""


@dataclass(frozen=True)
class Teleoperation(Simulated):
    """Settings of episodes in simulated scenes of a task.

    Attributes:
        seed: Seed of the dataset.
        task: Name of the task.
        world: Physics, arm, sensors and cameras; the person sees the first camera.
    """

    seed: int
    task: str
    world: WorldConfig = field(default_factory=WorldConfig)
    versions: ClassVar[Sequence[str]] = simulated.VERSIONS

    def config(self) -> dict[str, Any]:
        """Return all settings except the seed, as JSON values."""
        return {"task": self.task, "world": asdict(self.world)}

    def begin(self, index: int) -> Begun:
        """Set up the scene of an index, and tare.

        Args:
            index: Number of the episode in the dataset.
        """
        world = self.opened
        task = task_class(self.task).begin(world, attempt_seed(self.seed, index, ATTEMPT))
        facts = {"drawn": task.drawn(), "index": index, "attempt": ATTEMPT, "rejected": []}
        return Begun(not world.holds(task.body), facts, task.success, task.state)


@dataclass(frozen=True)
class RobotTeleoperation(Connected):
    """Settings of episodes on a robot that is not simulated: only the person can determine when the task is achieved.

    Attributes:
        seed: Seed of the dataset, which changes nothing.
        task: Name of the task, which is free.
        robot: Name of the robot.
    """

    seed: int
    task: str
    robot: str
    versions: ClassVar[Sequence[str]] = connected.VERSIONS

    def config(self) -> dict[str, Any]:
        """Return all settings except the seed, as JSON values."""
        return {"task": self.task, "robot": self.robot}

    def begin(self, index: int) -> Begun:
        """Bring the robot home, and tare.

        Args:
            index: Number of the episode in the dataset.
        """
        self.opened.home()
        self.opened.tare()
        return Begun(True, {"index": index})
