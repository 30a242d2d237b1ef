"""Contract of a robot: what recording, teleoperation, policies and the viewer need."""

from collections.abc import Callable, Mapping
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from svfl_data.schema.declarations import Declarations
from svfl_data.schema.field import Field
from svfl_data.schema.observation import Frame as Frame  # imported for users of this module
from svfl_data.schema.observation import Observation as Observation
from svfl_data.schema.optics import Calibration as Calibration
from svfl_data.schema.optics import Optics as Optics
from svfl_data.schema.optics import image_axes as image_axes

Readings = Mapping[str, Mapping[str, NDArray[Any]]]
"""Rows by group, such as ``streams/wrench``, and name; ``t_ns``, shape (M,), [ns], are the times of the rows."""


class Robot(Protocol):
    """Protocol of a robot with its sensors. Simulation, a real arm and the playback of a record are implementations.

    The methods are called in this order: `connect`; for each episode `home`, `tare`, and `observe` and `step` in turn,
    with an `observe` at the end, then `stop`; at last `close`. After each `observe` follows one call of `readings`. The
    streams run by themselves, at the sensors' own rates.

    Attributes:
        name: Name of the robot, which its episodes keep.
        rate_hz: Number of steps per second, [Hz].
        declarations: Declarations of what the robot records that is not standard: its own fields, and its action.
        action: Declaration of ``actions/action`` with components, bounds and parts, also if it is the standard one.

    Example:
        >>> def moves(robot: Robot) -> bool:
        ...     before = robot.observe()
        ...     robot.step(np.array([1.0, 0.01, 0.0, 0.0, 0.0], np.float32))
        ...     return not np.array_equal(before.at("observations/proprio"), robot.observe().at("observations/proprio"))
    """

    @property
    def name(self) -> str:
        """Name of the robot, such as ``panda_sim``."""

    @property
    def rate_hz(self) -> float:
        """Number of steps per second, [Hz]."""

    @property
    def declarations(self) -> Declarations:
        """Declarations of the robot's own fields, and of its action if it is another than the planar one."""

    @property
    def action(self) -> Field:
        """Declaration of ``actions/action``."""

    @property
    def cameras(self) -> Mapping[str, Calibration | None]:
        """Calibration of each camera of the robot by name; None for a camera whose lens or pose is unknown."""

    def connect(self) -> None:
        """Connect to the robot. Connecting twice does no harm.

        Raises:
            CollectError: If the robot cannot be reached.
        """

    def home(self) -> None:
        """Move to the start of an episode, with the gripper open. The episode clock begins, and all readings are new.

        A robot that waits for a person before the first observation keeps as many of its readings as it wants to.
        """

    def tare(self) -> None:
        """Take the present wrenches as those of a free gripper. Does nothing on a robot without such sensors."""

    def observe(self) -> Observation:
        """Return the observation of the present moment. Times of observations ascend."""

    def readings(self) -> Readings:
        """Return the rows that the streams have got since the last call, raw, by group.

        The times of each group ascend over all calls. A stream without new rows is absent or has empty arrays. A group
        that has been here is recorded from here, and no longer from the observations: cameras and joints with a clock
        of their own can be here as well.
        """

    def step(self, action: NDArray[np.float32]) -> None:
        """Carry out one action for one step of 1 / `rate_hz`.

        Args:
            action: Action as `action` declares it, shape (A,).
        """

    def stop(self) -> None:
        """Stop all motion. Called at the end of an episode, also when an error ends it."""

    def close(self) -> None:
        """Disconnect from the robot. Closing twice does no harm."""

    def constants(self) -> Mapping[str, NDArray[Any]]:
        """Return the arrays that an episode has once, by dataset path: workspace, tares and calibrations, as known now.

        `svfl_data.schema.optics.Calibration.constants` makes those of a camera.
        """


Policy = Callable[[Observation], NDArray[np.float32] | None]
"""Function that returns the next action for an observation, shape (A,), or None to end the episode.

A policy that keeps the past of an episode has a method ``forget()`` as well, which the recording loop calls before the
first observation of each episode.
"""
Watcher = Callable[[Robot, Observation, NDArray[np.float32] | None, Readings], None]
"""Function that is called at each step with the robot, the observation, the action that led to it (None at the first
observation), and the readings since the observation before. What the function does is not recorded."""
