"""The simulated six-axis force-torque sensor between the arm's flange and the gripper."""

from collections.abc import Sequence

from collectors.simulation.bullet import pybullet

# In this mode PyBullet reports the reaction at a joint in base axes and about the joint's origin. Without it, PyBullet
# reports the reaction in the axes of the child link and about its centre of mass. This was found by experiment
# (pybullet 3.2.7), and a test checks it.
FEEDBACK_MODE = pybullet.JOINT_FEEDBACK_IN_JOINT_FRAME | pybullet.JOINT_FEEDBACK_IN_WORLD_SPACE


def wrench_from_reaction(reaction: Sequence[float]) -> tuple[float, ...]:
    """Turn the reaction of a joint into the reading of a sensor in that joint, which is the load on the gripper.

    PyBullet gives the force of the parent (flange) on the child (gripper). The sensor reads the opposite: the force of
    the environment, gravity and the gripper's own inertia on the gripper, F_external + m g - m a.

    Args:
        reaction: Force and torque of the flange on the gripper, six numbers, [N] and [N m], base axes, about the
            sensor origin.

    Returns:
        Load on the gripper, six numbers, [N] and [N m], base axes, about the sensor origin.
    """
    return tuple([-part for part in reaction])
