"""What a task is: a scene that is drawn, a world that is set up with it, a predicate that says when it is done."""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from collectors.recording.loop import OBJECT
from collectors.simulation.world import World
from collectors.tasks.gripper import Gripper, Moves
from svfl_data.errors import CollectError

DRAWS = 1000
"""Tries to draw a scene, of which the default workspace needs a few."""
MAX_STEPS = 50
"""Longest episode (Kohler et al., CoRL 2023, section 5.1)."""
ATTEMPTS = 20
"""Attempts that an expert makes at an episode; they are numbered from 0."""
POLICY_ATTEMPT = ATTEMPTS
"""Number of the attempt whose scenes policies are tried in; no expert makes it, so no demonstration shows its scene."""


def attempt_seed(seed: int, index: int, attempt: int) -> np.random.SeedSequence:
    """Source of all randomness of an attempt.

    Args:
        seed: Seed of the dataset.
        index: Index of the episode.
        attempt: Number of the attempt.
    """
    return np.random.SeedSequence([seed, index, attempt])


def two_apart(
    rng: np.random.Generator, low: NDArray[np.float64], high: NDArray[np.float64], apart: float
) -> NDArray[np.float64]:
    """Draw two places that are far enough apart.

    Args:
        rng: Source of all randomness.
        low: Lowest x, y, (2,), [m].
        high: Highest x, y, (2,), [m].
        apart: Least distance, [m].

    Returns:
        The places, (2, 2), [m].

    Raises:
        CollectError: If there is no room for them.
    """
    for _ in range(DRAWS):
        places: NDArray[np.float64] = rng.uniform(low, high, (2, 2))
        if math.dist(*places) >= apart:
            return places
    raise CollectError(f"no two places {apart} m apart between {low.tolist()} and {high.tolist()} in {DRAWS} draws")


class Task(ABC):
    """One scene of a task, set up in a world; a new object for every episode.

    A subclass is a task. It draws its scene as numbers (a frozen dataclass), puts it into the world when it is made,
    and reads success off the true state.

    Attributes:
        world: The world it is set up in.
        scene: What was drawn.
        body: Body id of the object that the task is about.
    """

    color: ClassVar[tuple[float, float, float]] = (0.0, 0.35, 0.75)
    """RGB of the object that the task is about, where tasks do not draw it."""

    world: World
    scene: Any
    body: int

    @classmethod
    @abstractmethod
    def draw(cls, rng: np.random.Generator, world: World) -> Any:  # noqa: ANN401 - each task has its own scene
        """Draw a scene; nothing is put into the world.

        Args:
            rng: Source of all randomness.
            world: For its bounds.

        Returns:
            A frozen dataclass of numbers, base axes, SI units.
        """

    @abstractmethod
    def __init__(self, world: World, scene: Any) -> None:  # noqa: ANN401
        """Put a scene into a world that has just been reset."""

    @abstractmethod
    def success(self) -> bool:
        """Whether the task is achieved, read off the true state."""

    @abstractmethod
    def expert(self, gripper: Gripper) -> Moves:
        """The actions of a scripted expert who knows the true state, until the task is achieved or time is up."""

    def state(self) -> Mapping[str, np.ndarray]:
        """True values of the moment, for the record; `OBJECT` is the pose of the task's object."""
        return {OBJECT: self.world.pose(self.body)}

    @classmethod
    def begin(cls, world: World, seed: np.random.SeedSequence) -> Self:
        """Reset a world, draw a scene, set it up and tare; the same seed gives the same bytes from here on.

        Args:
            world: Any world; what it was used for before does not matter.
            seed: Seed of scene and sensor noise; not spawned from.
        """
        scene_seed, noise_seed = seed.generate_state(2)
        world.reset(seed=int(noise_seed))
        task = cls(world, cls.draw(np.random.default_rng(int(scene_seed)), world))
        world.tare()
        return task

    def drawn(self) -> dict[str, Any]:
        """The scene as JSON values."""
        return asdict(self.scene)
