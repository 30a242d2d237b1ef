"""The movements that scripted experts are made of."""

import math
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from collectors.simulation.world import World

Moves = Iterator[NDArray[np.float32]]
"""Iterator of actions, (5,) float32. Take an action only after the world has carried out the action before it."""

RAMP = 1 / 3  # share of full speed gained or lost per step: 3.3 m/s^2, a few newtons of inertia at the wrist
JITTER = np.array([0.0008, 0.0008, 0.0008, 0.012])  # [m], [rad] standard deviation of a step at noise 1
LOOSE = np.array([0.008, 0.008, 0.010, 0.08])  # [m], [rad] standard deviation of a loose waypoint at noise 1
FIRM = 0.3  # share of the time of full travel for which fingers must hold: slow ones squeeze a round object out late
SLOWEST = 0.75  # share of full speed in the slowest episodes at noise 1


def never() -> bool:
    """Return False: the condition that is never met."""
    return False


class Lasting:
    """Condition that holds when another condition has held at several calls in a row."""

    def __init__(self, condition: Callable[[], bool], calls: int) -> None:
        self._condition, self._calls, self._held = condition, calls, 0

    def __call__(self) -> bool:
        """Check the other condition, and return whether it held at this call and at the calls before."""
        self._held = self._held + 1 if self._condition() else 0
        return self._held >= self._calls


def nearest_turn(theta: float, period: float, near: float = 0.0) -> float:
    """Return the yaw nearest to `near` that the gripper can reach and that is `theta` plus a multiple of `period`.

    Args:
        theta: Wanted yaw, [rad].
        period: Angle after which a turned gripper or object looks the same, at most pi, [rad].
        near: Present yaw, within +-pi/2, [rad].

    Returns:
        Yaw within +-pi/2, [rad].
    """
    turned = theta - period * round((theta - near) / period)
    return turned if abs(turned) <= math.pi / 2 else turned - math.copysign(period, turned)


def travel_steps(world: World, travels: float) -> int:
    """Return the number of steps in which the fingers travel from open to closed `travels` times, rounded up."""
    return math.ceil(travels * world.fingers.travel_s / world.step_s - 1e-6)


class Gripper:
    """Movements of the commanded pose of a world's gripper, with a soft start and stop.

    Every movement is a generator of actions, to be used with ``yield from``. A movement may read the true state between
    two actions.

    Attributes:
        world: World whose gripper is moved.
        rng: Source of the random differences between demonstrations.
        noise: Amount by which demonstrations differ: 0 not at all, 1 as intended, 2 at most on the command line.
        opening: Gripper opening in every action, 0 closed to 1 open.
    """

    def __init__(self, world: World, rng: np.random.Generator, noise: float = 1.0, opening: float = 1.0) -> None:
        """Take over a gripper that is at rest, and draw the pace of the episode.

        Args:
            world: World whose gripper is moved.
            rng: Source of the random differences between demonstrations.
            noise: Amount by which demonstrations differ: 0 not at all, 1 as intended.
            opening: Gripper opening to begin with, 0 closed to 1 open.
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
        """Move the commanded pose in a straight line to a goal.

        Args:
            x: Goal x in base, [m]. None keeps the commanded x.
            y: Goal y in base, [m]. None keeps the commanded y.
            z: Goal z in base, [m]. None keeps the commanded z.
            theta: Goal yaw, [rad]. None keeps the commanded yaw.
            speed: Fraction of the largest action.
            loose: Whether the goal is approximate, so that noise is added to the given parts of it.
            exact: Whether the way must be free of jitter, as it must be near contact.
            until: Condition that ends the movement early. It is checked before every action.

        Yields:
            Actions. The movement ends at the goal or, because a command cannot get far from a blocked gripper, after
            about twice the steps that a free gripper takes.
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
            # Largest speed from which the gripper can still stop in the remaining way if it loses RAMP per step.
            stopping = 0.5 * (math.sqrt(RAMP * RAMP + 8.0 * RAMP * steps) - RAMP)
            moving = min(pace, moving + RAMP, max(stopping, 0.05 * pace), steps)
            move = left * (moving / steps)
            if not exact and steps > 1.0:
                move = move + self.noise * JITTER * np.clip(self.rng.standard_normal(4), -2, 2)
            yield self._action(np.clip(move, -bound, bound))

    def vary(self, values: ArrayLike, deviation: float) -> NDArray[np.float64]:
        """Add Gaussian noise to values, cut at two standard deviations.

        Args:
            values: Values to vary, any shape.
            deviation: Standard deviation at noise 1, in the unit of `values`.

        Returns:
            The varied values, in the shape of `values`.
        """
        values = np.asarray(values, np.float64)
        return values + self.noise * deviation * np.clip(self.rng.standard_normal(values.shape), -2, 2)

    def grip(self, opening: float, travels: float = 1.0, until: Callable[[], bool] = never) -> Moves:
        """Open or close the gripper and wait until the fingers have moved.

        Args:
            opening: Gripper opening from now on, 0 closed to 1 open.
            travels: Time for which the gripper rests while the fingers move, in units of the time of their full travel.
            until: Condition that ends the wait early when it has held for the share `FIRM` of the time of full travel,
                because fingers may touch an object and part again.

        Yields:
            Actions that open or close the gripper without moving it.
        """
        self.opening = opening
        lasting = Lasting(until, travel_steps(self.world, FIRM))
        yield from self.rest(travel_steps(self.world, travels), lasting)

    def rest(self, steps: int, until: Callable[[], bool] = never) -> Moves:
        """Keep the commanded pose for some steps.

        Args:
            steps: Number of steps.
            until: Condition that ends the rest early. It is checked before every action.

        Yields:
            Actions that do not move the gripper.
        """
        for _ in range(steps):
            if until():
                return
            yield self._action(np.zeros(4))

    def _action(self, move: NDArray[np.float64]) -> NDArray[np.float32]:
        return np.array([self.opening, *move], np.float32)
