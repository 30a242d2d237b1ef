"""The contract of a simulated gripper: the shape of its fingers, and the forces with which its drive moves them."""

from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True)
class Fingers:
    """Shape and travel of two parallel fingers, as far as scenes and experts depend on them.

    The fingers mirror each other and move along the finger axis, which is base y at yaw 0. At opening 0 their inner
    faces meet in the middle, below the TCP.

    Attributes:
        stroke: Distance from the middle to the inner face of an open finger, along the finger axis, [m].
        thickness: Thickness of a fingertip along the finger axis, [m].
        breadth: Breadth of a fingertip across the finger axis, [m].
        tip: Distance from the TCP down to the fingertips, [m].
        palm: Distance from the TCP up to the palm, [m]: whatever is higher touches the gripper's body.
        travel_s: Time that the fingers take from open to closed, [s].
    """

    stroke: float
    thickness: float
    breadth: float
    tip: float
    palm: float
    travel_s: float

    @property
    def outer(self) -> float:
        """Distance from the middle to the outer face of an open finger, along the finger axis, [m]."""
        return self.stroke + self.thickness


class Gripper(Protocol):
    """Protocol of a gripper with two fingers, each on a prismatic joint that is driven by a force.

    A gripper keeps the state of its drive between two physics steps, and can be copied by `copy.deepcopy`.
    """

    def opening(self, left: float, right: float) -> float:
        """Return the opening, 0 closed to 1 open, of fingers at these distances from the middle, [m]."""

    def force(
        self, opening: float, left: float, right: float, left_rate: float, right_rate: float
    ) -> tuple[float, float]:
        """Return the forces on the fingers for the next physics step.

        Args:
            opening: Wanted opening, 0 closed to 1 open.
            left: Distance of the left finger from the middle, [m].
            right: Distance of the right finger from the middle, [m].
            left_rate: Speed of the left finger, [m/s].
            right_rate: Speed of the right finger, [m/s].

        Returns:
            Force on the left and on the right finger, [N]. A positive force opens the gripper.
        """
