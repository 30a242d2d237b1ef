"""The movements that scripted experts are made of."""

import math
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from collectors.simulation.world import World

Moves = Iterator[NDArray[np.float32]]
"""Actions, one by one: each is taken when the world has carried out the one before."""

RAMP = (
    1 / 3
)  # of full speed that is gained or lost per step: 3.3 m/s^2, which the gripper's inertia shows as a few newtons
JITTER = np.array([0.0008, 0.0008, 0.0008, 0.012])  # [m], [rad] of a step at noise 1, standard deviation
LOOSE = np.array([0.008, 0.008, 0.010, 0.08])  # [m], [rad] of a loose waypoint at noise 1, standard deviation
SLOWEST = 0.75  # of full speed, of the slowest episodes at noise 1


def never() -> bool:
    """The condition that does not come."""
    return False


class Lasting:
    """A condition that holds when another one has been found to hold two times in a row."""

    def __init__(self, condition: Callable[[], bool]) -> None:
        self._condition, self._held = condition, False

    def __call__(self) -> bool:
        """Ask the other one."""
        before, self._held = self._held, self._condition()
        return before and self._held


def nearest_turn(theta: float, period: float, near: float = 0.0) -> float:
    """The angle nearest to `near` that equals `theta` up to multiples of `period` and that the gripper can turn to.

    Args:
        theta: Wanted yaw, [rad].
        period: After which it looks the same, at most pi, [rad].
        near: Present yaw, within +-pi/2, [rad].
    """
    turned = theta - period * round((theta - near) / period)
    return turned if abs(turned) <= math.pi / 2 else turned - math.copysign(period, turned)


class Gripper:
    """Moves the commanded pose of a world's gripper, with a soft start and stop.

    Every movement is a generator of actions, to be used with ``yield from``. It may look at the true state between two
    actions.

    Attributes:
        world: The world whose gripper it is.
        rng: Source of the variety.
        noise: How much demonstrations differ: 0 not at all, 1 as expert_action, more at your own risk.
        opening: Gripper opening that goes with every action, 0 closed to 1 open.
    """

    def __init__(self, world: World, rng: np.random.Generator, noise: float = 1.0, opening: float = 1.0) -> None:
        """Take a gripper, at rest.

        Args:
            world: The world.
            rng: Source of the variety.
            noise: How much of it.
            opening: Gripper opening to begin with.
        """
        self.world, self.rng, self.noise, self.opening = world, rng, noise, opening
        self._pace = 1.0 - min(noise, 1.0) * (1.0 - SLOWEST) * rng.uniform()

    def go(
        self,
        x: float | None = None,
        y: float | None = None,
        z: float | None = None,
        theta: float | None = None,
        *,
        speed: float = 1.0,
        loose: bool = False,
        exact: bool = False,
        until: Callable[[], bool] = never,
    ) -> Moves:
        """Move the commanded pose in a straight line; what is not given stays.

        Args:
            x: Where to, base, [m].
            y: Where to, base, [m].
            z: Where to, base, [m].
            theta: With which yaw, [rad].
            speed: Fraction of the largest action.
            loose: Whether the goal is only roughly meant: it is varied with the noise.
            exact: Whether the way must not be jittered, such as near contact.
            until: Ends the movement early; asked before every action.

        Yields:
            Actions. Gives up after twice the steps that a free gripper takes, since a command cannot get far from a
            blocked gripper.
        """
        given = [x, y, z, theta]
        goal = np.array([t if g is None else g for g, t in zip(given, self.world.target, strict=True)])
        if loose:
            vary = np.array([g is not None for g in given])
            goal = goal + self.noise * vary * LOOSE * np.clip(self.rng.standard_normal(4), -2, 2)
        goal = self.world.within(goal)
        bound = self.world.action_bound
        pace = speed * self._pace
        moving, patience = 0.0, None
        while not until():
            left = goal - self.world.target
            steps = float(np.max(np.abs(left) / bound))  # at full speed
            if steps < 1e-6:
                return
            patience = 2 * math.ceil(steps / pace) + 6 if patience is None else patience - 1
            if patience == 0:
                return
            # The fastest that can still stop in the remaining way, losing RAMP per step.
            stopping = 0.5 * (math.sqrt(RAMP * RAMP + 8.0 * RAMP * steps) - RAMP)
            moving = min(pace, moving + RAMP, max(stopping, 0.05 * pace), steps)
            move = left * (moving / steps)
            if not exact and steps > 1.0:
                move = move + self.noise * JITTER * np.clip(self.rng.standard_normal(4), -2, 2)
            yield self._action(np.clip(move, -bound, bound))

    def vary(self, values: ArrayLike, deviation: float) -> NDArray[np.float64]:
        """Values with Gaussian noise of that standard deviation at noise 1, cut at two of them."""
        values = np.asarray(values, np.float64)
        return values + self.noise * deviation * np.clip(self.rng.standard_normal(values.shape), -2, 2)

    def grip(self, opening: float, steps: int = 4, until: Callable[[], bool] = never) -> Moves:
        """Open or close the gripper and wait for it.

        Args:
            opening: Gripper opening from now on, 0 closed to 1 open.
            steps: How long the gripper rests meanwhile; full travel takes 4.
            until: Ends the wait early, when it holds after two steps in a row: fingers may touch and part again.
        """
        self.opening = opening
        yield from self.rest(steps, Lasting(until))

    def rest(self, steps: int, until: Callable[[], bool] = never) -> Moves:
        """Stay for some steps."""
        for _ in range(steps):
            if until():
                return
            yield self._action(np.zeros(4))

    def _action(self, move: NDArray[np.float64]) -> NDArray[np.float32]:
        return np.array([self.opening, *move], np.float32)
