"""The simulated world: table, robot, wrist sensor and camera behind one 20 Hz step."""

import copy
import math
from collections.abc import Sequence
from dataclasses import dataclass
from types import TracebackType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from collectors.simulation.admittance import Admittance
from collectors.simulation.arms.arm import Arm
from collectors.simulation.bodies import RED, Bodies, Box, Vector3
from collectors.simulation.bullet import pybullet
from collectors.simulation.camera import Camera
from collectors.simulation.config import WorldConfig
from collectors.simulation.grippers.gripper import Fingers
from collectors.simulation.noise import SensorNoise
from collectors.simulation.reference import Leash, Reference
from collectors.simulation.wrist_sensor import FEEDBACK_MODE, WristReadings, wrench_from_reaction
from svfl_data.errors import CollectError, UsageError
from svfl_data.sampling.windows import WINDOW
from svfl_data.schema.action_fields import planar_action
from svfl_data.schema.declarations import Declarations
from svfl_data.schema.observation import Observation
from svfl_data.schema.optics import Calibration
from svfl_data.system.own_process import OwnProcess

RENEWED = 1000
"""Number of resets after which the world is built anew.

PyBullet keeps the shapes of removed bodies, up to 0.1 MB per reset.
"""
LEAD = 4.0
"""Largest distance of the command ahead of a free gripper, in stopping distances from full speed.

A free gripper that turns back at full speed needs 3.8 stopping distances.
"""
CARRIED = 512
"""Most wrench readings of an observation (1.02 s at 500 Hz): windows of a policy are whole from the first step on."""
GRAVITY = (0.0, 0.0, -9.81)  # [m/s^2]


@dataclass(frozen=True)
class _Home:
    """State of a world at rest, to which `World.reset` returns.

    PyBullet's own state, which it keeps under the number `state`, is not enough: it holds neither motor torques nor the
    controllers.
    """

    state: int
    bodies: int
    arm: Arm
    reference: Reference
    admittance: Admittance
    wrenches: NDArray[np.float64]


class World(OwnProcess):
    """One PyBullet world with its own client, which does not disturb other worlds in the same process.

    A `World` works only in the process that made it, and can be neither pickled nor copied.

    ```python
    with World(WorldConfig()) as world:
        world.reset(seed=0)
        block = world.add_box((0.025, 0.025, 0.025), (0.55, 0.0, 0.025), yaw=0.0, mass=0.1, friction=0.5)
        world.tare()
        world.step([1.0, 0.0, 0.0, -0.02, 0.0])
        observation = world.observe()
    ```

    Attributes:
        config: All numbers of the world.
        bodies: Object that adds bodies to the world.
        action: Declaration of an action: gripper opening, dx, dy, dz and dtheta, with the bounds of `config`.
        declarations: Declarations of what an episode of this world records.
        tare_offset: Wrench that is subtracted from the readings of an observation, (6,), [N] and [N m]. It is zero
            after a reset until `tare`.
    """

    def __init__(self, config: WorldConfig | None = None) -> None:
        """Open a PyBullet client. The first `reset` builds the world.

        Args:
            config: All numbers of the world. None means ``WorldConfig()``, whose numbers are the paper's where the
                paper gives them.
        """
        self.config = config or WorldConfig()
        self._dt = self.config.physics_dt_ns * 1e-9
        self._bounds = np.array(self.config.workspace)
        self.action = planar_action(self.config.max_move, self.config.max_turn)
        self.declarations = Declarations([self.action])
        stopping = (self.config.max_move / self.step_s) ** 2 / (2.0 * self.config.max_acceleration)
        self._leash = Leash(stopping, self.config.admittance.max_deviation)
        self._open()

    def _open(self) -> None:
        self._client: int = pybullet.connect(pybullet.DIRECT)
        if self._client < 0:
            raise CollectError("PyBullet opened no client: too many worlds are open in this process; close some")
        self._cameras = {name: Camera(camera, self.client) for name, camera in self.config.cameras.items()}
        self._home: _Home | None = None
        self._resets = 0
        self.bodies = Bodies(self.client)

    def __enter__(self) -> "World":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self.in_own_process:
            self.close()

    @property
    def client(self) -> int:
        """PyBullet client id of the world, for calls to PyBullet that `World` does not offer.

        Raises:
            UsageError: If the world is closed, or belongs to another process.
        """
        self.check_process()
        if self._client < 0:
            raise UsageError("this World is closed; make another one")
        return self._client

    def connect(self) -> None:
        """Open the PyBullet client again after `close`; an open world stays as it is."""
        self.check_process()
        if self._client < 0:
            self._open()

    def home(self) -> None:
        """Reset to an empty table. The sensor noise is that of a further episode; `reset` takes a seed."""
        self.reset(seed=self._resets)

    def stop(self) -> None:
        """Do nothing, since the arm moves only during `step`."""

    def close(self) -> None:
        """Release the PyBullet client, after which the world cannot be used. Closing it twice does no harm."""
        self.check_process()
        if self._client >= 0:
            pybullet.disconnect(self._client)
            self._client = -1

    def reset(self, seed: int) -> None:
        """Bring the world to its start: an empty table, the arm at home and at rest, the gripper open.

        The clock starts at 0 before the rest, whose readings are kept. The first reset builds the world, and later
        resets restore it. Nothing survives from before, so the same seed and actions give the same bytes in any
        process, whatever the world was used for before.

        Args:
            seed: Seed of the sensor noise, >= 0.

        Raises:
            UsageError: If the seed is negative.
        """
        self.check_process()
        if seed < 0:
            raise UsageError(f"seed must be >= 0, got {seed}")
        if self._resets == RENEWED:
            self.close()
            self._open()
        self._resets += 1
        if self._home is None:
            self._home = self._build()
        home = self._home
        for index in range(pybullet.getNumBodies(physicsClientId=self.client) - 1, home.bodies - 1, -1):
            body = pybullet.getBodyUniqueId(index, physicsClientId=self.client)
            pybullet.removeBody(body, physicsClientId=self.client)
        pybullet.restoreState(stateId=home.state, physicsClientId=self.client)
        self._arm, self._reference, self._admittance = copy.deepcopy((home.arm, home.reference, home.admittance))
        self._target = np.array([*self.config.home, 0.0])
        self._noise = SensorNoise(self.config.noise, self._dt, np.random.default_rng(np.random.SeedSequence(seed)))
        self._readings = WristReadings(self._noise(home.wrenches).astype(np.float32), self.config.physics_dt_ns)
        self.tare_offset = np.zeros(6, np.float32)

    def _build(self) -> "_Home":
        """Build the table and the arm, let the arm rest, and return the state of the world."""
        c = self.config
        pybullet.setGravity(*GRAVITY, physicsClientId=self.client)
        pybullet.setPhysicsEngineParameter(
            fixedTimeStep=self._dt,
            numSolverIterations=c.solver_iterations,
            jointFeedbackMode=FEEDBACK_MODE,
            deterministicOverlappingPairs=1,
            physicsClientId=self.client,
        )
        self.add_box((0.75, 0.75, 0.05), (0.5, 0.0, -0.05), 0.0, 0.0, c.table_friction, c.table_color)
        self._arm = c.robot.place(self.client, self._dt, np.array(c.home))
        acceleration = c.max_acceleration * self._dt**2 / c.max_move
        self._reference = Reference([*c.home, 0.0], self.action_bound.tolist(), acceleration, c.smoothing_steps)
        self._admittance = Admittance(c.admittance, self._dt)
        home = [*c.home, 0.0]
        wrenches = [self._advance(home, 1.0) for _ in range(c.settle_steps * c.physics_steps)]
        return _Home(
            state=pybullet.saveState(physicsClientId=self.client),
            bodies=pybullet.getNumBodies(physicsClientId=self.client),
            arm=self._arm,
            reference=self._reference,
            admittance=self._admittance,
            wrenches=np.array(wrenches),
        )

    def add_box(
        self,
        half_extents: Vector3,
        position: Vector3,
        yaw: float,
        mass: float,
        friction: float,
        color: Vector3 = RED,
    ) -> int:
        """Add a box. Use `bodies` to add other shapes.

        Args:
            half_extents: Half edge lengths of the box, (x, y, z), [m].
            position: Centre of the box in base, (x, y, z), [m].
            yaw: Rotation of the box about z, [rad].
            mass: Mass of the box, [kg]; 0 fixes the box in place.
            friction: Coulomb friction of the box; PyBullet multiplies it by the other body's.
            color: RGB of the box, 0 to 1.

        Returns:
            The body id, for `pose` and `finger_contacts`.
        """
        return self.bodies.add([Box(half_extents, color=color)], position, yaw, mass, friction)

    def tare(self) -> None:
        """Set `tare_offset`, (6,), [N] and [N m], to the mean of the last `WorldConfig.tare_readings` readings.

        The readings in `wrench` stay raw. Call `tare` right after `reset`, or after objects were added, while the arm
        is at home and at rest. A load that touches the gripper during the tare is missing from every tared reading.
        """
        self.check_process()
        last = self._readings.last(self.config.tare_readings)
        self.tare_offset = last.mean(axis=0, dtype=np.float64).astype(np.float32)

    def step(self, action: ArrayLike) -> None:
        """Carry out one action: 25 physics steps of 2 ms, each with one control update and one reading.

        The commanded pose moves by the action from the last commanded pose, not from the measured pose, so that a push
        can be kept up or increased. The reference follows the commanded pose with bounded acceleration and jerk, and
        the gripper follows the reference.

        Args:
            action: Gripper opening 0..1, dx, dy, dz [m], dtheta [rad], base axes, (5,). The action is clipped to the
                bounds of an action, and the commanded pose to the workspace.

        Raises:
            UsageError: If the action is not five finite numbers.
        """
        self.check_process()
        wanted = np.asarray(action, np.float64)
        if wanted.shape != (5,) or not np.isfinite(wanted).all():
            raise UsageError(f"an action is 5 finite numbers (opening, dx, dy, dz, dtheta), got {action!r}")
        opening = float(np.clip(wanted[0], 0.0, 1.0))
        start = self._target
        self._target = self._limit(start + np.clip(wanted[1:], -self.action_bound, self.action_bound))
        way = np.linspace(start, self._target, self.config.physics_steps + 1)[1:].tolist()
        wrenches = [self._advance(commanded, opening) for commanded in way]
        self._readings.append(self._noise(np.array(wrenches)).astype(np.float32))

    @property
    def name(self) -> str:
        """Name of the robot in this world, such as ``panda_sim``."""
        return self.config.robot.name

    @property
    def rate_hz(self) -> float:
        """Number of actions per second, [Hz]."""
        return 1.0 / self.step_s

    @property
    def step_s(self) -> float:
        """Time of an action, [s]."""
        return self._dt * self.config.physics_steps

    @property
    def action_bound(self) -> NDArray[np.float64]:
        """Largest absolute values of an action's dx, dy, dz [m] and dtheta [rad], (4,)."""
        c = self.config
        return np.array([c.max_move, c.max_move, c.max_move, c.max_turn])

    def within(self, target: NDArray[np.float64]) -> NDArray[np.float64]:
        """Clip a pose (x, y, z, theta) in base, (4,), [m] and [rad], to the workspace and the largest yaw."""
        position = np.clip(target[:3], self._bounds[:, 0], self._bounds[:, 1])
        return np.array([*position, np.clip(target[3], -self.config.max_yaw, self.config.max_yaw)])

    def _limit(self, target: NDArray[np.float64]) -> NDArray[np.float64]:
        """Clip a commanded (x, y, z, theta) to the workspace and, where the gripper is held up, near the reference."""
        low, high = np.transpose(self._leash.bounds(LEAD, self._reference, self._arm.position))
        return self.within(np.array([*np.clip(target[:3], low, high), target[3]]))

    def _advance(self, commanded: Sequence[float], opening: float) -> tuple[float, ...]:
        """Carry out one physics step: move the reference, command the arm, simulate, and read the wrench.

        Args:
            commanded: Commanded (x, y, z, theta) now, in base, [m] and [rad].
            opening: Commanded gripper opening, 0 closed to 1 open.

        Returns:
            The physical wrench on the gripper, six numbers, [N] and [N m], base axes, about the sensor origin.
        """
        arm, admittance, dt = self._arm, self._admittance, self._dt
        if not math.isfinite(sum(arm.joints)):
            raise CollectError("the simulated arm is unstable: its gains do not fit the time step or the masses")
        aim = self._leash.aim(commanded, self._reference, arm.position)
        reference, move = self._reference.pose, self._reference.step(aim)
        pose = [r + e for r, e in zip(reference, (*admittance.deviation, 0.0), strict=True)]
        motion = [m + rate * dt for m, rate in zip(move, (*admittance.rate, 0.0), strict=True)]
        before = arm.gripper_velocity
        arm.drive(pose, motion, opening)
        pybullet.stepSimulation(physicsClientId=self.client)
        arm.read()
        wrench = wrench_from_reaction(arm.reaction)
        # External force, without the weight and the inertia of the gripper: F - m (g - a).
        fx, fy, fz = (
            felt - arm.gripper_mass * (g - (now - last) / dt)
            for felt, g, now, last in zip(wrench[:3], GRAVITY, arm.gripper_velocity, before, strict=True)
        )
        admittance.step((fx, fy, fz))
        return wrench

    def observe(self, render: bool = True) -> Observation:
        """Render the cameras and read the state after the latest step.

        Args:
            render: Whether to render the cameras. Without images, `frames` is empty and a step takes about half the
                time.

        Returns:
            The observation, whose wrench window is tared.
        """
        self.check_process()
        arm, pose = self._arm, self._tcp_pose
        wrench_t_ns, recent = self._readings.last_times(CARRIED), self._readings.last(CARRIED) - self.tare_offset
        return Observation(
            t_ns=int(wrench_t_ns[-1]),
            frames={name: camera.render(pose) for name, camera in self._cameras.items()} if render else {},
            wrench=recent[-WINDOW:],
            proprio=np.array([arm.opening, *arm.position, arm.theta], np.float32),
            joints=np.array(arm.joints, np.float32),
            tcp=None if pose is None else np.array(self.tcp),
            values={"streams/wrench/t_ns": wrench_t_ns, "streams/wrench/wrench": recent},
        )

    def readings(self) -> dict[str, dict[str, np.ndarray]]:
        """Return the raw wrench readings since the last call, or since the reset, as the rows of ``streams/wrench``."""
        self.check_process()
        return {"streams/wrench": self._readings.new()}

    def constants(self) -> dict[str, np.ndarray]:
        """Return the arrays that an episode has once, by dataset path: workspace, tare, and calibration of cameras."""
        found = {"workspace": np.array(self.workspace), "streams/wrench/tare": np.array(self.tare_offset, np.float64)}
        for name, calibration in self.cameras.items():
            found |= calibration.constants(name)
        return found

    @property
    def _tcp_pose(self) -> NDArray[np.float64] | None:
        """Pose of the TCP in base, (4, 4), or of home before the first reset; None if no camera is on the gripper."""
        if not any(camera.mounted for camera in self._cameras.values()):
            return None
        pose = np.eye(4)
        if self._home is None:
            pose[:3, :3], pose[:3, 3] = np.diag([1.0, -1.0, -1.0]), self.config.home
            return pose
        tcp = self.tcp
        pose[:3, :3] = np.reshape(pybullet.getMatrixFromQuaternion(tcp[3:]), (3, 3))
        pose[:3, 3] = tcp[:3]
        return pose

    @property
    def wrench(self) -> NDArray[np.float32]:
        """All raw readings since reset, (M, 6), [N] and [N m], base axes, about the sensor origin."""
        return self._readings.wrench

    @property
    def wrench_t_ns(self) -> NDArray[np.int64]:
        """Time of each reading since reset, (M,), [ns]. The first reading is one physics step after the reset."""
        return self._readings.t_ns

    @property
    def workspace(self) -> NDArray[np.float64]:
        """Lower and upper bounds of the commanded TCP x, y, z in base, (3, 2), [m]."""
        return self._bounds

    @property
    def cameras(self) -> dict[str, Calibration]:
        """Intrinsics, pose, image axes and depth scale of each camera, by name."""
        return {name: camera.calibration(self._tcp_pose) for name, camera in self._cameras.items()}

    @property
    def camera(self) -> Calibration:
        """Calibration of the first camera, in whose image-aligned axes block-centering scenes are drawn.

        Raises:
            UsageError: If the world has no camera.
        """
        if not self._cameras:
            raise UsageError("this World has no camera; name one in WorldConfig.cameras")
        return next(iter(self._cameras.values())).calibration(self._tcp_pose)

    @property
    def robot(self) -> int:
        """Body id of the robot, for tasks that call PyBullet with `client`."""
        return self._arm.body

    @property
    def sensor_joint(self) -> int:
        """Index of the robot's joint where the wrist sensor is, which is also that of the gripper's link."""
        return self._arm.sensor_joint

    @property
    def gripper_mass(self) -> float:
        """Mass of the gripper, whose weight the wrist sensor reads, [kg]."""
        return self._arm.gripper_mass

    @property
    def finger_links(self) -> tuple[int, int]:
        """Link indices of the robot's left and right finger."""
        return self._arm.finger_links

    @property
    def fingers(self) -> Fingers:
        """Shape and travel of the robot's fingers."""
        return self.config.robot.fingers

    @property
    def target(self) -> NDArray[np.float64]:
        """Commanded TCP x, y, z [m] and theta [rad] in base, (4,), at which a free gripper comes to rest."""
        return self._target.copy()

    @property
    def reference(self) -> NDArray[np.float64]:
        """Reference TCP x, y, z [m] and theta [rad] in base, (4,), at which a free gripper is now."""
        return np.array(self._reference.pose)

    @property
    def tcp(self) -> NDArray[np.float64]:
        """True TCP pose in base: position [m] and quat_xyzw, (7,)."""
        return np.array([*self._arm.position, *self._arm.quat])

    def pose(self, body: int) -> NDArray[np.float64]:
        """Return the true pose of a body in base: position of its centre of mass [m] and quat_xyzw, (7,)."""
        position, quat_xyzw = pybullet.getBasePositionAndOrientation(body, physicsClientId=self.client)
        return np.array([*position, *quat_xyzw])

    def yaw(self, body: int) -> float:
        """Return the true yaw of an upright body in base, [rad], in (-pi, pi]."""
        x, y, z, w = self.pose(body)[3:]
        return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))

    def holds(self, body: int) -> bool:
        """Return whether both fingers press on a body now."""
        return all(self.finger_contacts(body))

    def finger_contacts(self, body: int) -> tuple[bool, bool]:
        """Return whether the left finger, and whether the right finger, presses on a body now."""
        left, right = (self._presses(finger, body) for finger in self._arm.finger_links)
        return left, right

    def _presses(self, link: int, body: int) -> bool:
        contacts: Sequence[tuple] = pybullet.getContactPoints(
            self._arm.body, body, linkIndexA=link, physicsClientId=self.client
        )
        return any(contact[9] > 0.0 for contact in contacts)  # field 9 is the normal force
