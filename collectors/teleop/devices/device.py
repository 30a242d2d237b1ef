"""What a person steers with."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from enum import StrEnum
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from svfl_data.errors import CollectError

FINE = 0.25
"""Of the pace, while the control for fine movements is held."""


class Command(StrEnum):
    """What a person tells the session, beside how to move."""

    START = "start"
    SUCCESS = "success"
    STOP = "stop"
    DISCARD = "discard"
    AGAIN = "again"
    TARE = "tare"
    QUIT = "quit"


class DeviceLostError(CollectError):
    """The device was unplugged, or no longer answers."""


class Device(ABC):
    """A device; adding one means a subclass and a line in `collectors.teleop.devices.by_name` (docs/teleoperation.md).

    Attributes:
        name: What the episodes it makes are marked with.
        controls: Control and meaning, in pairs, for the screen.
    """

    name: str
    controls: ClassVar[Sequence[tuple[str, str]]] = ()

    @abstractmethod
    def read(self) -> NDArray[np.float32]:
        """Where its controls are now; asked once for each action, of 50 ms.

        Returns:
            (opening, right, away, up, turn), (5,): gripper opening 0..1, then fractions -1..1 of the full pace, right
            and away as the camera's picture shows them, turn counter-clockwise seen from above.

        Raises:
            DeviceLostError: If it was unplugged.
        """

    def commands(self) -> list[Command]:
        """What its buttons told since it was last asked."""
        return []

    def handle(self, event: Any) -> None:  # noqa: ANN401, B027 - pygame has no common type of events
        """An event of the window, if there is one and the device lives on them."""

    def begin(self, opened: bool) -> None:  # noqa: B027
        """An episode begins: the gripper is at home, open or holding something."""

    def touch(self, newtons: float) -> None:  # noqa: B027
        """The gripper has come into contact: let it be felt, if the device can."""

    def close(self) -> None:  # noqa: B027
        """Let go of the device."""


def reading(opening: float, *motion: float) -> NDArray[np.float32]:
    """The five numbers of `Device.read`."""
    return np.array([opening, *motion], np.float32) + np.float32(0.0)  # no -0.0, which would be 0.0 in a log


def without_rest(value: float, zone: float) -> float:
    """A stick's deflection with a zone around rest that counts as none; beyond it, from 0 on without a jump.

    Args:
        value: -1..1.
        zone: Half the width of the zone.
    """
    beyond = max(abs(value) - zone, 0.0) / (1.0 - zone)
    return float(np.copysign(beyond, value))
