"""The reference between two 20 Hz actions: the pose that a free gripper has, with bounded acceleration and jerk."""

import math
from collections import deque
from collections.abc import Sequence

Pose = tuple[float, ...]  # (x, y, z, theta)


class Reference:
    """Follows the commanded pose as fast as a bound on its acceleration allows, then smooths by a moving average.

    The commanded pose moves at constant speed during a tick. A tracker goes after it: in every physics step it takes
    the largest speed from which it can still stop at the commanded pose, changing its velocity by no more than the
    bound. The moving average over a time T then bounds the jerk to twice the acceleration over T. Both add no
    overshoot, and both end exactly at the commanded pose. At constant speed v the reference is late by the way that
    stopping takes, v^2 / (2 a), and by v T / 2.

    Distances and speeds are measured as the largest of the four components, each in units of the bound of an action.
    So the bound holds for each component, and a movement along a straight line stays on it, with the yaw in proportion.

    Sources: Zanasi, Guarino Lo Bianco and Tonielli (2000), "Nonlinear filters for the generation of smooth
    trajectories" (the tracker); Biagiotti and Melchiorri (2012), "FIR filters for online trajectory planning with
    time- and frequency-domain specifications" (the average).
    """

    def __init__(self, pose: Sequence[float], bound: Sequence[float], acceleration: float, smoothing: int) -> None:
        """Start at rest.

        Args:
            pose: Where, (x, y, z, theta), [m] and [rad].
            bound: Largest |dx|, |dy|, |dz| [m] and |dtheta| [rad] of an action.
            acceleration: Largest change of the motion in a physics step from one to the next, in units of `bound`.
            smoothing: Length of the moving average, in physics steps.
        """
        self._bound = tuple(bound)
        self._acceleration = acceleration
        self._velocity: Pose = (0.0, 0.0, 0.0, 0.0)  # in units of the bound, per physics step
        self._tracked = deque([tuple(pose)] * smoothing, maxlen=smoothing)
        self.pose: Pose = self._mean()

    @property
    def tracker(self) -> Pose:
        """Pose before the moving average, (x, y, z, theta), [m] and [rad]: where `pose` is going."""
        return self._tracked[-1]

    def step(self, aim: Sequence[float]) -> Pose:
        """Move on by one physics step.

        Args:
            aim: Commanded pose now, (x, y, z, theta), [m] and [rad].

        Returns:
            Motion of `pose` in this step, (dx, dy, dz, dtheta), [m] and [rad].
        """
        left = [(to - at) / bound for to, at, bound in zip(aim, self.tracker, self._bound, strict=True)]
        farthest = max(map(abs, left))
        share = self._fastest(farthest) / farthest if farthest else 0.0
        change = [share * way - speed for way, speed in zip(left, self._velocity, strict=True)]
        part = self._acceleration / max(self._acceleration, *map(abs, change))
        self._velocity = tuple(map(self._faster, self._velocity, change, [part] * 4))
        self._tracked.append(
            tuple(at + v * bound for at, v, bound in zip(self.tracker, self._velocity, self._bound, strict=True))
        )
        before, self.pose = self.pose, self._mean()
        return tuple(after - at for after, at in zip(self.pose, before, strict=True))

    def _fastest(self, way: float) -> float:
        """Largest motion in a step from which one can stop within `way`, giving up the acceleration in every step."""
        a = self._acceleration
        steps = max(1, math.ceil(0.5 * (math.sqrt(1.0 + 8.0 * way / a) - 1.0)))
        return way / steps + 0.5 * a * (steps - 1)

    def _faster(self, speed: float, change: float, part: float) -> float:
        """A component's next speed: all gain speed in proportion, which keeps lines straight, but each brakes alone."""
        if speed * change < 0.0:
            return speed + min(max(change, -self._acceleration), self._acceleration)
        return speed + part * change

    def _mean(self) -> Pose:
        return tuple(sum(parts) / len(self._tracked) for parts in zip(*self._tracked, strict=True))
