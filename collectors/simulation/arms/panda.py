"""The Franka Emika Panda with its hand: which files it is loaded from, and what is changed in them."""

import math
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal
from xml.etree import ElementTree

import numpy as np
import pybullet_data
from numpy.typing import NDArray

from collectors.simulation.arms.torque_arm import Model, TorqueArm, TorqueArmConfig
from collectors.simulation.grippers.gripper import Fingers
from collectors.simulation.grippers.panda_hand import FINGER_BOXES, panda_fingers
from collectors.simulation.grippers.parallel import GripperConfig, ParallelGripper

# Elbow-up posture in which Franka's own examples start, [rad]. It decides which way the elbow points.
POSTURE = (0.0, -math.pi / 4, 0.0, -3 * math.pi / 4, 0.0, math.pi / 2, math.pi / 4)


@dataclass(frozen=True)
class PandaConfig(TorqueArmConfig):
    """Configuration of the Panda: its surface, its control, its gripper and its meshes.

    Attributes:
        name: Name of the robot.
        gripper: Configuration of the gripper's drive.
        full_meshes: Whether to draw the arm with its fine visual meshes, which look better in images and are about
            eight times slower to render.
    """

    name: Literal["panda_sim"] = "panda_sim"
    gripper: GripperConfig = field(default_factory=GripperConfig)
    full_meshes: bool = False

    @property
    def fingers(self) -> Fingers:
        """Shape and travel of the hand's fingers."""
        return panda_fingers(self.gripper)

    def place(self, client: int, dt: float, home: NDArray[np.float64]) -> TorqueArm:
        """Load the Panda and place it at home, with the gripper open and pointing down with yaw 0.

        Args:
            client: PyBullet client id of the world.
            dt: Time of a physics step, [s].
            home: TCP position in base, (3,), [m].
        """
        model = Model(
            urdf_text(self.full_meshes),
            inertia_from_urdf=False,
            posture=POSTURE,
            sensor="panda_hand",
            fingers=("panda_leftfinger", "panda_rightfinger"),
            finger_depth=0.0584,
            tcp="panda_grasptarget",
            tcp_depth=0.105,
        )
        return TorqueArm(self, model, ParallelGripper(self.gripper, dt), client, dt, home)


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
