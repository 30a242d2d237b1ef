"""A gripper of two parallel fingers that share one motor of limited force."""

from dataclasses import dataclass

from collectors.simulation.bounds import NotNegative, Positive


@dataclass(frozen=True)
class GripperConfig:
    """Configuration of the drive of a parallel gripper. The defaults are those of the Panda's hand.

    Attributes:
        stroke: Travel of a finger from closed to open, [m] (panda.urdf).
        speed: Speed of a finger, [m/s] (limit in panda.urdf).
        force: Largest force of the motor on a finger, [N] (effort limit in panda.urdf; Franka's datasheet says up to
            70 N).
        stiffness: Force on a finger per position error, [N/m].
        damping: Force on a finger per speed, [N s/m].
    """

    stroke: Positive = 0.04
    speed: Positive = 0.2
    force: Positive = 20.0
    stiffness: Positive = 5000.0
    damping: NotNegative = 30.0


class ParallelGripper:
    """Force law of a gripper whose two fingers share one motor of limited force and a stiff, symmetric linkage."""

    def __init__(self, config: GripperConfig, dt: float) -> None:
        """Start with the gripper open.

        Args:
            config: Configuration of the gripper's drive.
            dt: Control period, [s].
        """
        self._config = config
        self._reach = config.speed * dt
        self._target = config.stroke

    def opening(self, left: float, right: float) -> float:
        """Return the opening, 0 closed to 1 open, of fingers at these distances from the middle, [m]."""
        return (left + right) / (2.0 * self._config.stroke)

    def force(
        self, opening: float, left: float, right: float, left_rate: float, right_rate: float
    ) -> tuple[float, float]:
        """Return the forces on the fingers for the next physics step.

        Args:
            opening: Wanted opening, 0 closed to 1 open. The fingers move to it at `GripperConfig.speed`.
            left: Distance of the left finger from the middle, [m].
            right: Distance of the right finger from the middle, [m].
            left_rate: Speed of the left finger, [m/s].
            right_rate: Speed of the right finger, [m/s].

        Returns:
            Force on the left and on the right finger, [N]. A positive force opens the gripper.
        """
        c = self._config
        wanted = opening * c.stroke - self._target
        self._target += min(max(wanted, -self._reach), self._reach)
        motor = c.stiffness * (self._target - 0.5 * (left + right)) - 0.5 * c.damping * (left_rate + right_rate)
        motor = min(max(motor, -c.force), c.force)
        linkage = 0.5 * (c.stiffness * (right - left) + c.damping * (right_rate - left_rate))
        return motor + linkage, motor - linkage
