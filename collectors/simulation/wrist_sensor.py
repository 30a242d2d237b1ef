"""The six-axis force-torque sensor between flange and gripper."""

from collections.abc import Sequence

from collectors.simulation.bullet import pybullet

# In this mode PyBullet reports the reaction at a joint in base axes and about the joint's origin; without it, in the
# axes and about the centre of mass of the child link. Found by experiment (pybullet 3.2.7), held by the tests.
FEEDBACK_MODE = pybullet.JOINT_FEEDBACK_IN_JOINT_FRAME | pybullet.JOINT_FEEDBACK_IN_WORLD_SPACE


def wrench_from_reaction(reaction: Sequence[float]) -> tuple[float, ...]:
    """Turn the joint reaction into what a sensor in that joint reads: the load on the gripper.

    PyBullet gives the force of the parent (flange) on the child (gripper). The sensor feels the opposite: everything
    that the environment, gravity and the gripper's own inertia put on it, F_external + m g - m a.

    Args:
        reaction: Force and torque of the flange on the gripper, six numbers, [N] and [N m].

    Returns:
        Load on the gripper, six numbers, [N] and [N m], base axes, about the sensor origin (`panda_hand_joint`).
    """
    return tuple([-part for part in reaction])
