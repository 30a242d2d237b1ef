"""The hand of the Franka Emika Panda: the shape of its fingers."""

from collectors.simulation.grippers.gripper import Fingers
from collectors.simulation.grippers.parallel import GripperConfig

# Edges (x, y, z) and centre (y, z) of the boxes of a finger, [m], in its link's axes: tip, then base. Measured on
# meshes/collision/finger.obj of pybullet_data's franka_panda; y points outward, the tip's inner face is at y = 0.
FINGER_BOXES = (((0.0175, 0.0142, 0.0348), (0.0071, 0.0364)), ((0.0208, 0.0238, 0.0190), (0.0144, 0.0095)))


def panda_fingers(config: GripperConfig) -> Fingers:
    """Return the shape of the fingers, measured as `FINGER_BOXES`, relative to the TCP.

    Args:
        config: Configuration of the drive, whose stroke and speed the fingers have.
    """
    travel = config.stroke / config.speed
    return Fingers(config.stroke, thickness=0.014, breadth=0.0175, tip=0.0072, palm=0.040, travel_s=travel)
