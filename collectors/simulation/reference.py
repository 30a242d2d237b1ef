"""The reference: the pose that a free gripper has between two 20 Hz actions, with bounded acceleration and jerk."""

import math
from collections import deque
from collections.abc import Sequence

Pose = tuple[float, ...]  # (x, y, z, theta)


class Reference:
    """Pose that follows the commanded pose as fast as bounds on its acceleration and jerk allow.

    The commanded pose moves at constant speed during an action. A tracker follows the commanded pose: in every physics
    step the tracker takes the largest speed from which it can still stop at the commanded pose, and changes its
    velocity by no more than the bound a. A moving average of the tracker over a time T then bounds the jerk to 2 a / T.
    Neither the tracker nor the average overshoots, and both end exactly at the commanded pose. At constant speed v the
    reference is behind the commanded pose by the stopping distance, v^2 / (2 a), plus v T / 2.

    Distances and speeds are measured as the largest of the four components, each in units of the bound of an action.
    So the bound holds for each component, and a movement along a straight line stays on the line, with the yaw in
    proportion.

    Sources: Zanasi, Guarino Lo Bianco and Tonielli (2000), "Nonlinear filters for the generation of smooth
    trajectories" (the tracker); Biagiotti and Melchiorri (2012), "FIR filters for online trajectory planning with
    time- and frequency-domain specifications" (the average).

    Attributes:
        pose: Reference pose now, in base, (x, y, z, theta), [m] and [rad].
    """

    def __init__(self, pose: Sequence[float], bound: Sequence[float], acceleration: float, smoothing: int) -> None:
        """Start at rest.

        Args:
            pose: Start pose in base, (x, y, z, theta), [m] and [rad].
            bound: Largest |dx|, |dy|, |dz| [m] and |dtheta| [rad] of an action.
            acceleration: Largest change, from one physics step to the next, of the motion in a physics step, in units
                of `bound`.
            smoothing: Length of the moving average, in physics steps.
        """
        self._bound = tuple(bound)
        self._acceleration = acceleration
        self._velocity: Pose = (0.0, 0.0, 0.0, 0.0)  # in units of the bound, per physics step
        self._tracked = deque([tuple(pose)] * smoothing, maxlen=smoothing)
        self.pose: Pose = self._mean()

    @property
    def tracker(self) -> Pose:
        """Pose before the moving average, in base, (x, y, z, theta), [m] and [rad], to which `pose` is moving."""
        return self._tracked[-1]

    def step(self, aim: Sequence[float]) -> Pose:
        """Move the reference on by one physics step.

        Args:
            aim: Commanded pose now, in base, (x, y, z, theta), [m] and [rad].

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
        """Return the largest motion in a step from which the tracker, braking in every step, can stop within `way`."""
        a = self._acceleration
        steps = max(1, math.ceil(0.5 * (math.sqrt(1.0 + 8.0 * way / a) - 1.0)))
        return way / steps + 0.5 * a * (steps - 1)

    def _faster(self, speed: float, change: float, part: float) -> float:
        """Return the next speed of a component.

        All components gain speed in proportion, which keeps lines straight, but each component brakes independently.
        """
        if speed * change < 0.0:
            return speed + min(max(change, -self._acceleration), self._acceleration)
        return speed + part * change

    def _mean(self) -> Pose:
        return tuple(sum(parts) / len(self._tracked) for parts in zip(*self._tracked, strict=True))


class Leash:
    """Bounds about the reference for the commanded position, which are nearer where the gripper is held up.

    A bound leaves no distance when the gripper is `reach` behind the reference.

    Args:
        stopping: Stopping distance from full speed, [m].
        reach: Largest deviation of the gripper from the reference, [m].
    """

    def __init__(self, stopping: float, reach: float) -> None:
        self._stopping, self._reach = stopping, reach

    def bounds(self, times: float, reference: Reference, gripper: Sequence[float]) -> list[tuple[float, float]]:
        """Return lower and upper bounds of x, y, z, [m], at `times` the stopping distance from full speed.

        Args:
            times: Number of stopping distances that are left to a free gripper.
            reference: The reference.
            gripper: Measured TCP position in base, (x, y, z), [m].
        """
        reach = self._reach
        stretch = times * self._stopping / reach

        def way(left: float) -> float:
            return left * stretch if left > 0.0 else left

        places = zip(reference.tracker, reference.pose, gripper, strict=False)
        return [(track - way(reach + at - tcp), track + way(reach - at + tcp)) for track, at, tcp in places]

    def aim(self, commanded: Sequence[float], reference: Reference, gripper: Sequence[float]) -> Sequence[float]:
        """Return the pose that the reference moves to: the commanded pose, limited where the gripper is held up.

        Args:
            commanded: Commanded pose, (x, y, z, theta), [m] and [rad].
            reference: The reference.
            gripper: Measured TCP position in base, (x, y, z), [m].
        """
        limits = zip(commanded, self.bounds(1.0, reference, gripper), strict=False)
        return [*(min(max(to, low), high) for to, (low, high) in limits), commanded[3]]
