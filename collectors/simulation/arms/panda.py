"""The Franka Emika Panda with its gripper in PyBullet: how it is loaded, read and driven."""

import math
import re
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pybullet_data
from numpy.typing import NDArray

from collectors.simulation.arms.kinematics import POSTURE, gripper_velocity, jacobian_array, joint_motion
from collectors.simulation.arms.servo import Servo, ServoConfig, rotation_error
from collectors.simulation.bounds import NotNegative, Positive
from collectors.simulation.bullet import pybullet
from collectors.simulation.grippers.panda_hand import Gripper, GripperConfig
from collectors.simulation.linear import sum_of_products

ARM = range(7)
SENSOR_JOINT = 8  # panda_hand_joint, a fixed joint where the wrist sensor is
LEFT_FINGER, RIGHT_FINGER = 9, 10
TCP_LINK = 11  # panda_grasptarget, 0.105 m below the sensor
MOVING = (*ARM, LEFT_FINGER, RIGHT_FINGER)
SENSED = (*MOVING, SENSOR_JOINT)
STILL = (0.0,) * len(MOVING)
DISTAL = (SENSOR_JOINT, LEFT_FINGER, RIGHT_FINGER)  # the links that the sensor carries


@dataclass(frozen=True)
class PandaConfig:
    """Configuration of the robot: its surface, its meshes, its control and its gripper.

    Attributes:
        friction: Coulomb friction of the robot's surface, fingers included; PyBullet multiplies it by the object's.
        pad_stiffness: Stiffness of one contact point of the robot's surface, [N/m]. The default is that of rubber, not
            steel.
        pad_damping: Damping of one contact point of the robot's surface, [N s/m].
        full_meshes: Whether to draw the arm with its fine visual meshes, which look better in images and are about
            eight times slower to render.
        servo: Gains of the arm's inner control loop.
        gripper: Configuration of the gripper's drive.
    """

    friction: NotNegative = 1.0
    pad_stiffness: Positive = 10_000.0
    pad_damping: NotNegative = 50.0
    full_meshes: bool = False
    servo: ServoConfig = field(default_factory=ServoConfig)
    gripper: GripperConfig = field(default_factory=GripperConfig)


# Edges (x, y, z) and centre (y, z) of the boxes of a finger, [m], in its link's axes: tip, then base. Measured on
# meshes/collision/finger.obj of pybullet_data's franka_panda; y points outward, the tip's inner face is at y = 0.
FINGER_BOXES = (((0.0175, 0.0142, 0.0348), (0.0071, 0.0364)), ((0.0208, 0.0238, 0.0190), (0.0144, 0.0095)))


def urdf_text(full_meshes: bool) -> str:
    """Return the Panda's URDF with absolute mesh paths.

    By default the arm and the palm are drawn with the coarse collision meshes, because the cost of the software
    renderer grows with the number of triangles: about 100,000 in the fine meshes, and 4,656 in the coarse ones. The
    fingers keep their fine meshes, so that a person recognises them.

    The fingers collide as boxes of the mesh's size. The tips of the mesh are tilted by 0.3 mm and touch a flat block
    with one corner, on the same side of both fingers. This turns the lever arm that the wrist sensor reads by 6
    degrees, so that the gripper would not be its own mirror image.

    The stops of the fingers are moved out by 1 mm, so that an open or closed gripper does not press on them:
    PyBullet's joint stops falsify the wrist readings by up to 3 %.

    Args:
        full_meshes: Whether the arm and the palm are drawn with their fine visual meshes.
    """
    folder = Path(pybullet_data.getDataPath()) / "franka_panda"
    text = (folder / "panda.urdf").read_text()
    if not full_meshes:
        text = re.sub(r"meshes/visual/(link\d|hand)", r"meshes/collision/\1", text)
    text = text.replace('lower="0.0" upper="0.04"', 'lower="-0.001" upper="0.041"').replace("package://", f"{folder}/")
    robot = ElementTree.fromstring(text)
    for name, outward in (("panda_leftfinger", 1.0), ("panda_rightfinger", -1.0)):
        link = robot.find(f"link[@name='{name}']")
        assert link is not None
        link.remove(link.find("collision"))  # type: ignore[arg-type]
        for size, (y, z) in FINGER_BOXES:
            collision = ElementTree.SubElement(link, "collision")
            ElementTree.SubElement(collision, "origin", xyz=f"0 {outward * y} {z}")
            geometry = ElementTree.SubElement(collision, "geometry")
            ElementTree.SubElement(geometry, "box", size=" ".join(map(str, size)))
    return ElementTree.tostring(robot, encoding="unicode")


class Panda:
    """One Panda in one PyBullet world, with its base at the origin.

    The attributes below, but for `body` and `gripper_mass`, are the state after the latest physics step. The state is
    kept as tuples, as PyBullet returns and accepts it, because conversion to arrays 500 times a second costs more than
    the computations with them.

    Attributes:
        body: Body id of the robot.
        gripper_mass: Mass of the gripper and its fingers, which the sensor carries, [kg].
        joints: Angles of the seven arm joints, [rad], then positions of the left and the right finger, [m].
        rates: Rates of the seven arm joints, [rad/s], then of the left and the right finger, [m/s].
        position: TCP position in base, (x, y, z), [m].
        quat: TCP orientation in base, quat_xyzw.
        gripper_velocity: Velocity of the centre of mass of gripper and fingers, (x, y, z), [m/s], base axes.
        reaction: Raw joint reaction at the sensor, six numbers, [N] and [N m], base axes (see
            `collectors.simulation.wrist_sensor`).
    """

    def __init__(self, config: PandaConfig, client: int, dt: float, home: NDArray[np.float64]) -> None:
        """Load the robot and place it at home, with the gripper open and pointing down with yaw 0.

        Args:
            config: Configuration of the robot.
            client: PyBullet client id of the world.
            dt: Time of a physics step, [s].
            home: TCP position in base, (3,), [m].
        """
        self._client = client
        self._dt = dt
        self._stroke = config.gripper.stroke
        self.body = self._load(config)
        self._measure_gripper()
        self._place(home)
        self._servo = Servo(config.servo, dt, np.array(self.joints[:7]))
        self._gripper = Gripper(config.gripper, dt)

    def _load(self, config: PandaConfig) -> int:
        client = self._client
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "panda.urdf"
            path.write_text(urdf_text(config.full_meshes))
            body: int = pybullet.loadURDF(str(path), useFixedBase=True, physicsClientId=client)
        for link in (-1, *range(TCP_LINK + 1)):
            pybullet.changeDynamics(
                body,
                link,
                linearDamping=0.0,  # no air drag, which would show in the wrist readings
                angularDamping=0.0,
                jointDamping=0.0,
                lateralFriction=config.friction,
                # The URDF's 0.1 at the fingers causes a torque that PyBullet's joint reaction leaves out. With it, the
                # readings of a mug held by its handle were wrong by 14 % in force and by 80 % in torque.
                spinningFriction=0.0,
                rollingFriction=0.0,
                contactStiffness=config.pad_stiffness,
                contactDamping=config.pad_damping,
                physicsClientId=client,
            )
        # The robot is driven by torques: switch PyBullet's own motors off.
        pybullet.setJointMotorControlArray(
            body, MOVING, pybullet.VELOCITY_CONTROL, forces=[0.0] * len(MOVING), physicsClientId=client
        )
        pybullet.enableJointForceTorqueSensor(body, SENSOR_JOINT, True, physicsClientId=client)
        return body

    def _measure_gripper(self) -> None:
        """Measure the gripper's mass, and the height of its centre of mass above the TCP when it points down."""
        masses, depths = [], []
        for link, joint_depth in zip(DISTAL, (0.0, 0.0584, 0.0584), strict=True):  # depths of panda.urdf
            info = pybullet.getDynamicsInfo(self.body, link, physicsClientId=self._client)
            masses.append(info[0])
            depths.append(joint_depth + info[3][2])
        self.gripper_mass: float = sum(masses)
        self._com_above_tcp = 0.105 - float(sum_of_products(masses, depths)) / self.gripper_mass

    def _place(self, position: NDArray[np.float64]) -> None:
        joints = np.array([*POSTURE, self._stroke, self._stroke])
        x, y, z = position.tolist()
        for _ in range(50):  # Newton's method, which converges to rounding after about 10 iterations
            for joint, value in zip(MOVING, joints, strict=True):
                pybullet.resetJointState(self.body, joint, value, physicsClientId=self._client)
            self.read(forward_kinematics=True)
            joints[:7] += joint_motion(self._jacobian, np.array(self._error(x, y, z, 0.0)), np.zeros(7), 1e-3)

    def read(self, forward_kinematics: bool = False) -> None:
        """Read the state from the simulator.

        Args:
            forward_kinematics: Whether PyBullet recomputes the link poses, which is needed only after joints were set
                without a physics step.
        """
        states = pybullet.getJointStates(self.body, SENSED, physicsClientId=self._client)
        positions, rates, reactions, _ = zip(*states, strict=True)
        self.joints, self.rates, self.reaction = positions[:9], rates[:9], reactions[9]
        link = pybullet.getLinkState(
            self.body, TCP_LINK, computeForwardKinematics=forward_kinematics, physicsClientId=self._client
        )
        self.position, self.quat = link[4], link[5]
        linear, angular = pybullet.calculateJacobian(
            self.body, TCP_LINK, STILL[:3], self.joints, STILL, STILL, physicsClientId=self._client
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
        return (self.joints[7] + self.joints[8]) / (2.0 * self._stroke)

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
        left, right = self._gripper.force(opening, *self.joints[7:], *self.rates[7:])
        pybullet.setJointMotorControlArray(
            self.body,
            MOVING,
            pybullet.TORQUE_CONTROL,
            forces=[*torque[:7], torque[7] + left, torque[8] + right],
            physicsClientId=self._client,
        )

    def _error(self, x: float, y: float, z: float, theta: float) -> tuple[float, float, float, float, float, float]:
        """Return the wanted minus the present TCP pose, six numbers, [m] and [rad], base axes."""
        at = self.position
        return (x - at[0], y - at[1], z - at[2], *rotation_error(theta, self.quat))
