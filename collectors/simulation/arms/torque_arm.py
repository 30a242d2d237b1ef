"""An arm with any number of joints in PyBullet, which follows the TCP command by joint torques."""

import math
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from collectors.simulation.arms.arm import RobotConfig
from collectors.simulation.arms.kinematics import gripper_velocity, jacobian_array, joint_motion
from collectors.simulation.arms.servo import Servo, ServoConfig, rotation_error
from collectors.simulation.bounds import NotNegative, Positive, Vector3
from collectors.simulation.bullet import pybullet
from collectors.simulation.grippers.gripper import Gripper
from collectors.simulation.linear import sum_of_products


@dataclass(frozen=True)
class Model:
    """What a robot is made of, from its base to the TCP.

    Attributes:
        urdf: Text of the robot's URDF, in which mesh paths are absolute. Its moving joints are those of the arm from
            the base to the flange, and then the prismatic joints of the left and the right finger.
        inertia_from_urdf: Whether the URDF holds inertias. Otherwise PyBullet computes them from the shapes.
        posture: Angles of the arm's A joints from which the home position is found, and to which the joints return as
            far as this does not move the gripper, [rad].
        sensor: Name of the child link of the sensor's fixed joint.
        fingers: Names of the left and the right finger's links.
        finger_depth: Distance of the fingers' frames from the sensor, away from the flange, [m].
        tcp: Name of the link whose frame is the TCP.
        tcp_depth: Distance of the TCP from the sensor, away from the flange, [m].
    """

    urdf: str
    inertia_from_urdf: bool
    posture: tuple[float, ...]
    sensor: str
    fingers: tuple[str, str]
    finger_depth: float
    tcp: str
    tcp_depth: float


@dataclass(frozen=True, kw_only=True)
class TorqueArmConfig(RobotConfig):
    """Configuration of a robot's surface and control, which are the same numbers for every robot.

    Attributes:
        name: Name of the robot, which every subclass has as its default.
        friction: Coulomb friction of the robot's surface, fingers included; PyBullet multiplies it by the object's.
        pad_stiffness: Stiffness of one contact point of the robot's surface, [N/m]. The default is that of rubber, not
            steel.
        pad_damping: Damping of one contact point of the robot's surface, [N s/m].
        servo: Gains of the arm's inner control loop.
    """

    name: str
    friction: NotNegative = 1.0
    pad_stiffness: Positive = 10_000.0
    pad_damping: NotNegative = 50.0
    servo: ServoConfig = field(default_factory=ServoConfig)


class TorqueArm:
    """One robot in one PyBullet world: an `collectors.simulation.arms.arm.Arm`, whose attributes it has.

    The state is kept as tuples, as PyBullet returns and accepts it, because conversion to arrays 500 times a second
    costs more than the computations with them.

    Attributes:
        rates: Rates of the arm's joints, [rad/s], then of the left and the right finger, [m/s].
    """

    position: Vector3
    quat: tuple[float, float, float, float]
    gripper_velocity: Vector3

    def __init__(
        self,
        config: TorqueArmConfig,
        model: Model,
        gripper: Gripper,
        client: int,
        dt: float,
        home: NDArray[np.float64],
    ) -> None:
        """Load the robot and place it at home, with the gripper open and pointing down with yaw 0.

        Args:
            config: Surface and control of the robot.
            model: Arm and gripper of the robot.
            gripper: Drive of the gripper in the model.
            client: PyBullet client id of the world.
            dt: Time of a physics step, [s].
            home: TCP position in base, (3,), [m].
        """
        self._client = client
        self._dt = dt
        self._arm = len(model.posture)
        self.gripper = gripper
        self.body = self._load(config, model)
        self._measure_gripper(model)
        self._place(home, [*model.posture, config.fingers.stroke, config.fingers.stroke])
        self._servo = Servo(config.servo, dt, np.array(self.joints[: self._arm]), np.array(model.posture))

    def _load(self, config: TorqueArmConfig, model: Model) -> int:
        client = self._client
        flags = pybullet.URDF_USE_INERTIA_FROM_FILE if model.inertia_from_urdf else 0
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "robot.urdf"
            path.write_text(model.urdf)
            body: int = pybullet.loadURDF(str(path), useFixedBase=True, flags=flags, physicsClientId=client)
        infos = [
            pybullet.getJointInfo(body, joint, physicsClientId=client)
            for joint in range(pybullet.getNumJoints(body, physicsClientId=client))
        ]
        links = {info[12].decode(): info[0] for info in infos}
        self._moving = tuple(info[0] for info in infos if info[2] != pybullet.JOINT_FIXED)
        self._still = (0.0,) * len(self._moving)
        self.sensor_joint, self._tcp = links[model.sensor], links[model.tcp]
        self.finger_links = (links[model.fingers[0]], links[model.fingers[1]])
        assert self._moving[self._arm :] == self.finger_links, f"moving joints {self._moving}"
        for link in (-1, *links.values()):
            pybullet.changeDynamics(
                body,
                link,
                linearDamping=0.0,  # no air drag, which would show in the wrist readings
                angularDamping=0.0,
                jointDamping=0.0,
                lateralFriction=config.friction,
                # The Panda's URDF has 0.1 at the fingers. It causes a torque that PyBullet's joint reaction leaves out:
                # the readings of a mug held by its handle were wrong by 14 % in force and by 80 % in torque.
                spinningFriction=0.0,
                rollingFriction=0.0,
                contactStiffness=config.pad_stiffness,
                contactDamping=config.pad_damping,
                physicsClientId=client,
            )
        # The robot is driven by torques: switch PyBullet's own motors off.
        pybullet.setJointMotorControlArray(
            body, self._moving, pybullet.VELOCITY_CONTROL, forces=list(self._still), physicsClientId=client
        )
        pybullet.enableJointForceTorqueSensor(body, self.sensor_joint, True, physicsClientId=client)
        return body

    def _measure_gripper(self, model: Model) -> None:
        """Measure the gripper's mass, and the height of its centre of mass above the TCP when it points down."""
        masses, depths = [], []
        for link, joint_depth in zip(
            (self.sensor_joint, *self.finger_links), (0.0, model.finger_depth, model.finger_depth), strict=True
        ):
            info = pybullet.getDynamicsInfo(self.body, link, physicsClientId=self._client)
            masses.append(info[0])
            depths.append(joint_depth + info[3][2])
        self.gripper_mass: float = sum(masses)
        self._com_above_tcp = model.tcp_depth - float(sum_of_products(masses, depths)) / self.gripper_mass

    def _place(self, position: NDArray[np.float64], start: list[float]) -> None:
        """Move the joints from their start to where the TCP is at a position, with the gripper pointing down."""
        joints = np.array(start)
        x, y, z = position.tolist()
        for _ in range(50):  # Newton's method, which converges to rounding after about 10 iterations
            for joint, value in zip(self._moving, joints, strict=True):
                pybullet.resetJointState(self.body, joint, value, physicsClientId=self._client)
            self.read(forward_kinematics=True)
            error = np.array(self._error(x, y, z, 0.0))
            joints[: self._arm] += joint_motion(self._jacobian, error, np.zeros(self._arm), 1e-3)

    def read(self, forward_kinematics: bool = False) -> None:
        """Read the state from the simulator.

        Args:
            forward_kinematics: Whether PyBullet recomputes the link poses, which is needed only after joints were set
                without a physics step.
        """
        states = pybullet.getJointStates(self.body, (*self._moving, self.sensor_joint), physicsClientId=self._client)
        positions, rates, reactions, _ = zip(*states, strict=True)
        self.joints, self.rates, self.reaction = positions[:-1], rates[:-1], reactions[-1]
        link = pybullet.getLinkState(
            self.body, self._tcp, computeForwardKinematics=forward_kinematics, physicsClientId=self._client
        )
        self.position, self.quat = link[4], link[5]
        linear, angular = pybullet.calculateJacobian(
            self.body, self._tcp, (0.0, 0.0, 0.0), self.joints, self._still, self._still, physicsClientId=self._client
        )
        self._jacobian = jacobian_array(linear, angular)
        self.gripper_velocity = gripper_velocity(self._jacobian, self.rates, self._com_above_tcp)

    @property
    def theta(self) -> float:
        """Yaw of the gripper, [rad], in (-pi, pi]. It is 0 when the fingers open along base y."""
        x, y, _, _ = self.quat
        return math.atan2(2.0 * x * y, x * x - y * y)

    @property
    def opening(self) -> float:
        """Measured gripper opening, 0 closed to 1 open."""
        return self.gripper.opening(*self.joints[-2:])

    def drive(self, pose: Sequence[float], motion: Sequence[float], opening: float) -> None:
        """Set the motor torques of the next physics step.

        The torques give the wanted joint accelerations to the robot alone (inverse dynamics, gravity included). A load
        acts on the robot as a disturbance.

        Args:
            pose: Wanted TCP pose now, in base, (x, y, z, theta), [m] and [rad].
            motion: Wanted motion of the TCP in this step, base axes, (dx, dy, dz, dtheta), [m] and [rad].
            opening: Wanted gripper opening, 0 closed to 1 open.
        """
        dx, dy, dz, dtheta = motion
        acceleration = self._servo.acceleration(
            self._jacobian, (dx, dy, dz, 0.0, 0.0, dtheta), self._error(*pose), self.joints, self.rates
        )
        torque = pybullet.calculateInverseDynamics(
            self.body, self.joints, self.rates, [*acceleration, 0.0, 0.0], physicsClientId=self._client
        )
        left, right = self.gripper.force(opening, *self.joints[-2:], *self.rates[-2:])
        pybullet.setJointMotorControlArray(
            self.body,
            self._moving,
            pybullet.TORQUE_CONTROL,
            forces=[*torque[:-2], torque[-2] + left, torque[-1] + right],
            physicsClientId=self._client,
        )

    def _error(self, x: float, y: float, z: float, theta: float) -> tuple[float, float, float, float, float, float]:
        """Return the wanted minus the present TCP pose, six numbers, [m] and [rad], base axes."""
        at = self.position
        return (x - at[0], y - at[1], z - at[2], *rotation_error(theta, self.quat))
