"""Moving a drawer without a robot."""

import pybullet


def slide(task, opening: float, speed: float = 0.0) -> None:
    """Put the drawer somewhere at once."""
    pybullet.resetJointState(task.body, 0, opening, speed, physicsClientId=task.world.client)
