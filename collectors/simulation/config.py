"""Every number of the simulated world, in one place."""

import math
from dataclasses import dataclass, field

from collectors.simulation.admittance import AdmittanceConfig
from collectors.simulation.arms.panda import PandaConfig
from collectors.simulation.bounds import Color, Count, Nanoseconds, NotNegative, Point, Positive, Range
from collectors.simulation.camera import CameraConfig
from collectors.simulation.noise import NoiseConfig
from svfl_data.errors import UsageError
from svfl_data.sampling.windows import WINDOW


@dataclass(frozen=True)
class WorldConfig:
    """Every number of the simulated world. Base frame = robot base = world frame, z up, table top at z = 0.

    Attributes:
        physics_dt_ns: Time of one physics step and between two readings, [ns] (500 Hz).
        physics_steps: Physics steps in one action (25 of 2 ms = 20 Hz).
        max_acceleration: Largest acceleration of the reference along each axis, [m/s^2]; the yaw takes as long to reach
            its full speed. The wrist feels 1.01 kg of gripper: 3.3 N, and up to 4.4 N while the joints settle.
        smoothing_steps: Physics steps of the moving average that bounds the jerk to 2 max_acceleration / its time.
        settle_steps: Steps of rest, without action, after a reset.
        tare_readings: Readings averaged by `World.tare`.
        workspace: Bounds of the commanded TCP (x, y, z), [m]; the lowest z lets the fingers press on the table.
        max_yaw: Bound of the commanded yaw, [rad]; with a two-finger gripper +-pi/2 are all directions.
        home: TCP position after reset, [m]; yaw 0, gripper open.
        max_move: Largest |dx|, |dy|, |dz| of an action, [m].
        max_turn: Largest |dtheta| of an action, [rad].
        table_friction: Coulomb friction of the table; PyBullet multiplies it by the object's.
        table_color: RGB of the table, 0 to 1.
        solver_iterations: Iterations of the contact solver in a physics step.
        panda: The arm.
        admittance: The compliance of the gripper.
        noise: The wrist sensor's noise.
        cameras: The cameras, by name; the first one is what a policy sees.
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
    panda: PandaConfig = field(default_factory=PandaConfig)
    admittance: AdmittanceConfig = field(default_factory=AdmittanceConfig)
    noise: NoiseConfig = field(default_factory=NoiseConfig)
    cameras: dict[str, CameraConfig] = field(default_factory=lambda: {"front": CameraConfig()})

    def __post_init__(self) -> None:
        """Refuse what no world can be made of.

        Raises:
            UsageError: If the workspace is empty or its home is outside, or rest is too short for a window of readings.
        """
        if not all(low < high for low, high in self.workspace):
            raise UsageError(f"a workspace has a low and a higher bound of x, y and z, got {self.workspace}")
        if not all(low <= at <= high for at, (low, high) in zip(self.home, self.workspace, strict=True)):
            raise UsageError(f"home {self.home} is outside the workspace {self.workspace}")
        if self.settle_steps * self.physics_steps < max(WINDOW, self.tare_readings):
            raise UsageError(f"the rest after a reset must have at least {max(WINDOW, self.tare_readings)} readings")
