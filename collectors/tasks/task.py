"""The base class of a task, which draws a scene, sets up a world with it, and says when the task is achieved."""

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
"""Largest number of draws for a scene. The default workspace needs a few."""
MAX_STEPS = 50
"""Longest episode, in steps (Kohler et al., CoRL 2023, section 5.1)."""
ATTEMPTS = 20
"""Largest number of attempts that an expert makes at an episode; they are numbered from 0."""
POLICY_ATTEMPT = ATTEMPTS
"""Attempt number of the scenes that policies are evaluated in; no expert makes it, so no demonstration shows them."""


def attempt_seed(seed: int, index: int, attempt: int) -> np.random.SeedSequence:
    """Return the seed sequence from which all randomness of an attempt comes.

    Args:
        seed: Seed of the dataset.
        index: Index of the episode.
        attempt: Number of the attempt.
    """
    return np.random.SeedSequence([seed, index, attempt])


def two_apart(
    rng: np.random.Generator, low: NDArray[np.float64], high: NDArray[np.float64], apart: float
) -> NDArray[np.float64]:
    """Draw two places on the table that are far enough apart.

    Args:
        rng: Source of all random numbers.
        low: Lowest x, y of a place in base, (2,), [m].
        high: Highest x, y of a place in base, (2,), [m].
        apart: Smallest distance between the places, [m].

    Returns:
        The x, y of each place in base, (2, 2), [m].

    Raises:
        CollectError: If no two such places are found in `DRAWS` draws.
    """
    for _ in range(DRAWS):
        places: NDArray[np.float64] = rng.uniform(low, high, (2, 2))
        if math.dist(*places) >= apart:
            return places
    raise CollectError(f"no two places {apart} m apart between {low.tolist()} and {high.tolist()} in {DRAWS} draws")


class Task(ABC):
    """One scene of a task, set up in a world. Every episode has its own `Task` object.

    Each task is a subclass. The subclass draws its scene as numbers (a frozen dataclass), puts the scene into the world
    when the object is made, and computes success from the true state.

    Attributes:
        world: World in which the scene is set up.
        scene: Numbers that were drawn for the scene.
        body: Body id of the object that the task is about.
    """

    color: ClassVar[tuple[float, float, float]] = (0.0, 0.35, 0.75)
    """RGB, 0 to 1, of the object that the task is about, unless the task draws the colour."""

    world: World
    scene: Any
    body: int

    @classmethod
    @abstractmethod
    def draw(cls, rng: np.random.Generator, world: World) -> Any:  # noqa: ANN401 - each task has its own scene
        """Draw a scene without putting anything into the world.

        Args:
            rng: Source of all random numbers.
            world: World whose workspace bounds the scene.

        Returns:
            A frozen dataclass of numbers in base axes and SI units.
        """

    @abstractmethod
    def __init__(self, world: World, scene: Any) -> None:  # noqa: ANN401
        """Put a scene into a world that has just been reset.

        Args:
            world: World to put the scene into.
            scene: Scene that `draw` returned.
        """

    @abstractmethod
    def success(self) -> bool:
        """Return whether the task is achieved, computed from the true state."""

    @abstractmethod
    def expert(self, gripper: Gripper) -> Moves:
        """Return the actions of a scripted expert that uses the true state.

        The caller takes the next action after the world has carried out the one before, and stops taking actions when
        the task is achieved or time is up.

        Args:
            gripper: Gripper of the task's world, which makes the actions.
        """

    def state(self) -> Mapping[str, np.ndarray]:
        """Return the true values to record at this moment, by name.

        The value named `OBJECT` is the pose of the task's object in base: position [m] and quat_xyzw, (7,).
        """
        return {OBJECT: self.world.pose(self.body)}

    @classmethod
    def begin(cls, world: World, seed: np.random.SeedSequence) -> Self:
        """Reset a world, draw a scene, set it up and tare. The same seed then gives the same bytes.

        Args:
            world: World to use. Its earlier use does not matter.
            seed: Seed of the scene and the sensor noise. `begin` does not spawn from it.

        Returns:
            The task, ready for its first action.
        """
        scene_seed, noise_seed = seed.generate_state(2)
        world.reset(seed=int(noise_seed))
        task = cls(world, cls.draw(np.random.default_rng(int(scene_seed)), world))
        world.tare()
        return task

    def drawn(self) -> dict[str, Any]:
        """Return the scene as JSON values."""
        return asdict(self.scene)
