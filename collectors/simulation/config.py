"""Configuration of the simulated world, with all its numbers in one place."""

import math
from dataclasses import dataclass, field

from collectors.simulation.admittance import AdmittanceConfig
from collectors.simulation.arms.arm import RobotConfig
from collectors.simulation.arms.panda import PandaConfig
from collectors.simulation.bounds import Color, Count, Nanoseconds, NotNegative, Point, Positive, Range
from collectors.simulation.camera import CameraConfig
from collectors.simulation.noise import NoiseConfig
from svfl_data.errors import UsageError
from svfl_data.sampling.windows import WINDOW


@dataclass(frozen=True)
class WorldConfig:
    """All numbers of the simulated world.

    The base frame is the frame of the robot's base and the world frame. Its z axis points up, and the table top is at
    z = 0.

    Attributes:
        physics_dt_ns: Time of one physics step, which is also the time between two readings, [ns] (500 Hz).
        physics_steps: Physics steps in one action (25 steps of 2 ms are 20 Hz).
        max_acceleration: Largest acceleration of the reference along each axis, [m/s^2]. The yaw takes the same time to
            reach its full speed. By default the inertia of the gripper, 1.01 kg, reads 3.3 N at the wrist, and up to
            4.4 N while the joints settle.
        smoothing_steps: Length of the reference's moving average, in physics steps. It bounds the jerk to
            2 max_acceleration divided by the time of the average.
        settle_steps: Steps at 20 Hz for which the arm rests after a reset, without an action.
        tare_readings: Number of readings that `World.tare` averages.
        workspace: Bounds of the commanded TCP (x, y, z) in base, [m]. The lowest z lets the fingers press on the table.
        max_yaw: Largest absolute commanded yaw, [rad]. For a two-finger gripper, -pi/2 to pi/2 holds all directions.
        home: TCP position after a reset, base (x, y, z), [m]. The yaw then is 0 and the gripper is open.
        max_move: Largest |dx|, |dy|, |dz| of an action, [m].
        max_turn: Largest |dtheta| of an action, [rad].
        table_friction: Coulomb friction of the table; PyBullet multiplies it by the object's.
        table_color: RGB of the table, 0 to 1.
        solver_iterations: Iterations of the contact solver in a physics step.
        robot: Configuration of the arm and its gripper.
        admittance: Compliance of the gripper.
        noise: Noise of the wrist sensor.
        cameras: Configuration of each camera, by name.
    """

    physics_dt_ns: Nanoseconds = 2_000_000
    physics_steps: Count = 25
    max_acceleration: Positive = 3.25
    smoothing_steps: Count = 20
    settle_steps: Count = 4
    tare_readings: Count = 50
    workspace: tuple[Range, Range, Range] = ((0.35, 0.75), (-0.2, 0.2), (-0.01, 0.25))
    max_yaw: NotNegative = math.pi / 2
    home: Point = (0.55, 0.0, 0.2)
    max_move: Positive = 0.025
    max_turn: Positive = math.pi / 16
    table_friction: NotNegative = 0.5
    table_color: Color = (0.62, 0.55, 0.47)
    solver_iterations: Count = 50
    robot: RobotConfig = field(default_factory=PandaConfig)
    admittance: AdmittanceConfig = field(default_factory=AdmittanceConfig)
    noise: NoiseConfig = field(default_factory=NoiseConfig)
    cameras: dict[str, CameraConfig] = field(default_factory=lambda: {"front": CameraConfig()})

    def __post_init__(self) -> None:
        """Refuse numbers that no world can have.

        Raises:
            UsageError: If the workspace is empty, `home` is outside the workspace, or the rest after a reset has fewer
                readings than a wrench window or than `tare_readings`.
        """
        if not all(low < high for low, high in self.workspace):
            raise UsageError(f"a workspace has a low and a higher bound of x, y and z, got {self.workspace}")
        if not all(low <= at <= high for at, (low, high) in zip(self.home, self.workspace, strict=True)):
            raise UsageError(f"home {self.home} is outside the workspace {self.workspace}")
        if self.settle_steps * self.physics_steps < max(WINDOW, self.tare_readings):
            raise UsageError(f"the rest after a reset must have at least {max(WINDOW, self.tare_readings)} readings")
