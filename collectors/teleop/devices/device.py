"""Device with which a person controls the gripper, and the commands that it can give."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from enum import StrEnum
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from svfl_data.errors import CollectError

FINE = 0.25
"""Fraction of the pace that applies while the control for fine movements is held."""


class Command(StrEnum):
    """Command from a person to the session, apart from motions."""

    START = "start"
    SUCCESS = "success"
    STOP = "stop"
    DISCARD = "discard"
    AGAIN = "again"
    TARE = "tare"
    QUIT = "quit"


class DeviceLostError(CollectError):
    """Error that the device was unplugged, or no longer answers."""


class Device(ABC):
    """Device that a person steers with.

    A new device needs a subclass, and a line in `collectors.teleop.devices.by_name` (docs/teleoperation.md).

    Attributes:
        name: Name of the device, which is stored in its episodes.
        controls: Controls of the device and their meanings, in pairs, for the screen.
    """

    name: str
    controls: ClassVar[Sequence[tuple[str, str]]] = ()

    @abstractmethod
    def read(self) -> NDArray[np.float32]:
        """Return the state of the device's controls; the session calls this once for each action of 50 ms.

        Returns:
            The reading (opening, right, away, up, turn), (5,). The gripper opening is 0 to 1. The others are fractions
            of the full pace, -1 to 1, with right and away as the camera's picture shows them, and turn
            counter-clockwise as seen from above.

        Raises:
            DeviceLostError: If the device was unplugged.
        """

    def commands(self) -> list[Command]:
        """Return the commands that the device's buttons have given since the last call."""
        return []

    def handle(self, event: Any) -> None:  # noqa: ANN401, B027 - pygame has no common type of events
        """Handle an event of the window, if there is a window and the device works through its events."""

    def begin(self, opened: bool) -> None:  # noqa: B027
        """Prepare for an episode, which begins with the gripper at home.

        Args:
            opened: Whether the gripper is open; otherwise it is holding something.
        """

    def touch(self, newtons: float) -> None:  # noqa: B027
        """Signal to the person that the gripper has come into contact, if the device can.

        Args:
            newtons: Magnitude of the contact force, [N].
        """

    def close(self) -> None:  # noqa: B027
        """Release the device."""


def reading(opening: float, *motion: float) -> NDArray[np.float32]:
    """Return the five numbers of `Device.read` as an array, (5,).

    Args:
        opening: Opening of the gripper, 0 to 1.
        motion: Components (right, away, up, turn) of the motion, -1 to 1.
    """
    return np.array([opening, *motion], np.float32) + np.float32(0.0)  # turns -0.0 into 0.0, which is what a log stores


def without_rest(value: float, zone: float) -> float:
    """Return a stick's deflection where a zone around rest counts as 0, and grows from 0 without a jump beyond it.

    Args:
        value: Deflection of the stick, -1 to 1.
        zone: Half of the zone's width.
    """
    beyond = max(abs(value) - zone, 0.0) / (1.0 - zone)
    return float(np.copysign(beyond, value))
