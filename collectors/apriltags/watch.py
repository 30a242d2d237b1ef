"""Tags at work: they say when a task is done and where the object is for a reset. No observation comes from them."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from collectors.apriltags.tracker import Track, Tracker
from svfl_data.errors import CollectError
from svfl_data.schema.robot import Calibration

MAX_AGE = 0.15  # [s] of a pose that success may rest on: three steps in which the gripper hid the object
LOOKS = 20  # of a reset, before a person is asked


class TagCamera(Protocol):
    """A camera that looks at tags; it may be another one than the policy's."""

    @property
    def calibration(self) -> Calibration:
        """Its calibration."""

    def __call__(self) -> tuple[int, NDArray[np.uint8]]:
        """Time of its latest picture on the episode clock [ns], and the picture, (H, W, 3) uint8 RGB."""


@dataclass(frozen=True)
class Reached:
    """The object lies within a distance of its goal.

    Attributes:
        goal: x, y in base, [m].
        within: Distance that is not reached, [m].
        below: Height of its origin in base that it must be below, [m]: it lies on the table.
    """

    goal: tuple[float, float]
    within: float
    below: float

    def __call__(self, pose: NDArray[np.float64]) -> bool:
        """Whether a pose, (7,), is one of success."""
        return math.dist(pose[:2], self.goal) < self.within and bool(pose[2] < self.below)


@dataclass(frozen=True)
class Lifted:
    """The object is off the table.

    Attributes:
        above: Height of its origin in base that it must be above, [m].
    """

    above: float

    def __call__(self, pose: NDArray[np.float64]) -> bool:
        """Whether a pose, (7,), is one of success."""
        return bool(pose[2] > self.above)


class Watch:
    """Watches an object while a policy acts.

    ```python
    watch = Watch(Tracker(layout, upright=True), {"tags": camera}, Reached(goal, 0.05, 0.03))
    arrays = record(robot, policy, 50, done=watch.done) | watch.tracker.arrays()
    ```

    Attributes:
        track: What was known at the last look.
    """

    def __init__(
        self,
        tracker: Tracker,
        cameras: Mapping[str, TagCamera],
        success: Callable[[NDArray[np.float64]], bool],
        max_age: float = MAX_AGE,
        now: Callable[[], int] | None = None,
    ) -> None:
        """Begin to watch, with a first look.

        Args:
            tracker: Of the object.
            cameras: By name; the next one is only asked when the one before does not see the object now.
            success: Whether a pose, (7,), is one of success: `Reached`, `Lifted`, or one's own.
            max_age: Of a pose that success may rest on, [s].
            now: Time on the episode clock, [ns]; without it, that of the picture that was looked at. Needed where a
                camera may hang: the pose in a picture that stays the same then grows old.
        """
        self.tracker, self.cameras, self.success, self.max_age, self.now = tracker, cameras, success, max_age, now
        self.track: Track | None = None
        self._sees = False
        self.look()

    def look(self) -> Track | None:
        """Look through the cameras until one sees the object; None if it has never been seen."""
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
        """Look, and say whether the task is achieved; to be asked once after each action, as `record` does."""
        self.look()
        return self.achieved

    @property
    def achieved(self) -> bool:
        """Whether the task was achieved at the last look: never because of a pose that was too old then."""
        track = self.track
        return track is not None and track.fresh(self.max_age) and self.success(track.pose)

    def reset_pose(self) -> NDArray[np.float64]:
        """Where the object is now, for a reset to fetch it, (7,); looks a few times.

        Raises:
            CollectError: If it is not seen.
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
