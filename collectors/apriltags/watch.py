"""Use of tags during a task: to detect when the task is achieved, and to locate the object for a reset.

No observation comes from tags.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from collectors.apriltags.tracker import Track, Tracker
from svfl_data.errors import CollectError
from svfl_data.schema.robot import Calibration

MAX_AGE = 0.15  # [s] largest age of a pose that success may rest on: three steps in which the gripper hid the object
LOOKS = 20  # number of looks for the object at a reset, before a person is asked to help


class TagCamera(Protocol):
    """Camera that looks at tags, which may be another camera than the policy's."""

    @property
    def calibration(self) -> Calibration:
        """Calibration of the camera."""

    def __call__(self) -> tuple[int, NDArray[np.uint8]]:
        """Return the time of the latest picture on the episode clock [ns], and the picture, (H, W, 3) uint8 RGB."""


@dataclass(frozen=True)
class Reached:
    """Success condition that the object lies within a distance of its goal.

    Attributes:
        goal: Position x, y of the goal in base, [m].
        within: Distance of the object's origin from the goal below which the goal is reached, [m].
        below: Height of the object's origin in base below which the object counts as lying on the table, [m].
    """

    goal: tuple[float, float]
    within: float
    below: float

    def __call__(self, pose: NDArray[np.float64]) -> bool:
        """Return whether a pose of the object is one of success.

        Args:
            pose: Position [m], quat_xyzw, base axes, (7,).
        """
        return math.dist(pose[:2], self.goal) < self.within and bool(pose[2] < self.below)


@dataclass(frozen=True)
class Lifted:
    """Success condition that the object is lifted off the table.

    Attributes:
        above: Height of the object's origin in base above which the object counts as lifted, [m].
    """

    above: float

    def __call__(self, pose: NDArray[np.float64]) -> bool:
        """Return whether a pose of the object is one of success.

        Args:
            pose: Position [m], quat_xyzw, base axes, (7,).
        """
        return bool(pose[2] > self.above)


class Watch:
    """Observer of an object's pose while a policy acts, which detects when the task is achieved.

    ```python
    watch = Watch(Tracker(layout, upright=True), {"tags": camera}, Reached(goal, 0.05, 0.03))
    arrays = record(robot, policy, 50, done=watch.done) | watch.tracker.arrays()
    ```

    Attributes:
        track: Last accepted pose of the object with its age at the last look, or None if it has never been seen.
    """

    def __init__(
        self,
        tracker: Tracker,
        cameras: Mapping[str, TagCamera],
        success: Callable[[NDArray[np.float64]], bool],
        max_age: float = MAX_AGE,
        now: Callable[[], int] | None = None,
    ) -> None:
        """Start with a first look at the object.

        Args:
            tracker: Tracker of the object.
            cameras: Cameras by name. The next camera is only asked when the one before does not see the object now.
            success: Function that returns whether a pose, (7,), is one of success: `Reached`, `Lifted`, or one's own.
            max_age: Largest age of a pose that success may rest on, [s].
            now: Function that returns the time on the episode clock, [ns]. None takes the time of the latest picture.
                It is needed where a camera may hang, so that the pose in a picture that stays the same grows old.
        """
        self.tracker, self.cameras, self.success, self.max_age, self.now = tracker, cameras, success, max_age, now
        self.track: Track | None = None
        self._sees = False
        self.look()

    def look(self) -> Track | None:
        """Look through the cameras until one sees the object.

        Returns:
            The last accepted pose of the object with its age, or None if the object has never been seen.
        """
        for camera in self.cameras.values():
            t_ns, picture = camera()
            self.track = self.tracker.see(picture, t_ns, camera.calibration)
            self._sees = self.track is not None and self.track.age == 0.0
            if self._sees:
                break
        if self.now is not None:
            self.track = self.tracker.at(self.now())
        return self.track

    def done(self) -> bool:
        """Look at the object and return whether the task is achieved; `record` calls this once after each action."""
        self.look()
        return self.achieved

    @property
    def achieved(self) -> bool:
        """Whether the task was achieved at the last look; a pose that was too old at that time never counts."""
        track = self.track
        return track is not None and track.fresh(self.max_age) and self.success(track.pose)

    def reset_pose(self) -> NDArray[np.float64]:
        """Look for the object up to `LOOKS` times, so that a reset can fetch it.

        Returns:
            The pose of the object now: position [m], quat_xyzw, base axes, (7,).

        Raises:
            CollectError: If the object is not seen.
        """
        for _ in range(LOOKS):
            track = self.look()
            if track is not None and self._sees and track.fresh(self.max_age):
                return track.pose
        ids = ", ".join(map(str, self.tracker.layout.tags))
        last = "never seen" if track is None else f"last seen {track.age:.1f} s ago at {np.round(track.pose[:3], 3)} m"
        raise CollectError(
            f"reset: the object with tags {ids} of {self.tracker.layout.family} is {last}; "
            f"put it where {', '.join(self.cameras)} can see it (refused: {dict(self.tracker.refused)})"
        )
