"""A parallel gripper with the size, weight and speed of the Robotiq 2F-85, as boxes and cylinders.

The fingers of the real gripper are moved by a linkage that keeps the pads parallel, and that lifts the fingertips by 13
mm from closed to open. Here each finger slides on a straight prismatic joint instead, with the fingertips always as far
from the flange as those of the closed gripper.

Source of the numbers: Robotiq, "2F-85 & 2F-140 Instruction Manual", section 6 (specifications): opening 85 mm, 0.925 kg
with the coupling, 162.8 mm from flange to fingertips when closed, centre of mass at 58 mm, closing at 20 to 150 mm/s
with 20 to 235 N, pads 22 mm broad. They are given from memory and have not been compared with a copy of the manual.
The masses of the fingers, the thickness of their tips and the depth of the palm are our choice.
"""

from dataclasses import dataclass

from collectors.simulation.bounds import NotNegative, Positive, Vector3
from collectors.simulation.grippers.gripper import Fingers
from collectors.simulation.grippers.parallel import GripperConfig
from collectors.simulation.urdf import Solid, UrdfBox, UrdfCylinder, joint, link

BODY, LEFT, RIGHT, TCP = "gripper", "left_finger", "right_finger", "tcp"
MASS = 0.925  # [kg] with coupling
FINGER_MASS = 0.1  # [kg], as much as a finger of the Panda
MASS_CENTRE = 0.058  # [m] from flange to centre of mass of the gripper with its fingers
LENGTH = 0.1628  # [m] from flange to fingertips
TIP = 0.0072  # [m] from the TCP down to the fingertips, as in the Panda's hand
PALM = 0.050  # [m] from the TCP up to the palm
BREADTH = 0.022  # [m] breadth of a finger
THICKNESS = 0.014  # [m] thickness of a fingertip, as in the Panda's hand
PAD = 0.0375  # [m] height of a pad
ROOT = 0.022  # [m] thickness of a finger above its pad
TCP_DEPTH = LENGTH - TIP
FINGER_DEPTH = TCP_DEPTH - PALM
BLACK: Vector3 = (0.16, 0.16, 0.18)
GREY: Vector3 = (0.35, 0.35, 0.38)


@dataclass(frozen=True)
class Robotiq2F85Config(GripperConfig):
    """Configuration of the drive of the gripper.

    Attributes:
        stroke: Travel of a finger from closed to open, [m]: half the opening of 85 mm.
        speed: Speed of a finger, [m/s]: half the highest closing speed of 150 mm/s.
        force: Largest force of the motor on a finger, [N]: the lowest grip force, which is also the Panda's here.
        stiffness: Force on a finger per position error, [N/m].
        damping: Force on a finger per speed, [N s/m].
    """

    stroke: Positive = 0.0425
    speed: Positive = 0.075
    force: Positive = 20.0
    stiffness: Positive = 5000.0
    damping: NotNegative = 30.0


def robotiq_fingers(config: GripperConfig) -> Fingers:
    """Return the shape of the fingers.

    Args:
        config: Configuration of the drive, whose stroke and speed the fingers have.
    """
    return Fingers(config.stroke, THICKNESS, BREADTH, TIP, PALM, travel_s=config.stroke / config.speed)


def urdf_text(flange: str, depth: float, stroke: float) -> str:
    """Return the links and joints of the gripper, fixed to an arm by a joint in which the wrist sensor is.

    The z axis of the gripper's frame points from the flange to the fingertips, and the left finger opens along y.

    Args:
        flange: Name of the arm's last link.
        depth: Distance of the flange from that link's frame along z, [m].
        stroke: Travel of a finger from closed to open, [m]. The stops of the fingers are 1 mm farther, because joints
            that press on stops falsify the wrist readings.
    """
    body: list[Solid] = [
        UrdfCylinder(0.0375, 0.08, "z", (0.0, 0.0, 0.04)),
        UrdfBox((0.044, 0.11, FINGER_DEPTH - 0.08), (0.0, 0.0, 0.5 * (FINGER_DEPTH + 0.08))),
    ]
    size = UrdfBox((0.075, 0.075, FINGER_DEPTH))
    mass = MASS - 2.0 * FINGER_MASS
    reach = PALM + TIP  # length of a finger
    finger_centre = 0.5 * reach
    centre = (MASS * MASS_CENTRE - 2.0 * FINGER_MASS * (FINGER_DEPTH + finger_centre)) / mass
    text = link(BODY, mass, (0.0, 0.0, centre), size.inertia(mass), body, BLACK)
    text += joint("fixed", flange, BODY, (0.0, 0.0, depth))
    for name, outward in ((LEFT, 1.0), (RIGHT, -1.0)):
        finger: list[Solid] = [
            UrdfBox((BREADTH, THICKNESS, PAD), (0.0, outward * 0.5 * THICKNESS, reach - 0.5 * PAD)),
            UrdfBox((BREADTH, ROOT, reach - PAD), (0.0, outward * (0.002 + 0.5 * ROOT), 0.5 * (reach - PAD))),
        ]
        inertia = UrdfBox((BREADTH, THICKNESS, reach)).inertia(FINGER_MASS)
        middle = (0.0, outward * 0.5 * THICKNESS, finger_centre)
        text += link(name, FINGER_MASS, middle, inertia, finger, GREY, sticky=True)
        limits = (-0.001, stroke + 0.001)
        text += joint("prismatic", BODY, name, (0.0, 0.0, FINGER_DEPTH), axis=(0.0, outward, 0.0), limits=limits)
    text += link(TCP, 0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), [], BLACK)
    return text + joint("fixed", BODY, TCP, (0.0, 0.0, TCP_DEPTH))
