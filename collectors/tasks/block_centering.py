"""Block centering as a task: after one finger has hit the block, move the gripper to where it can grasp the block.

The labelled samples of the paper's classification task come from ``svfl-collect centering``. This task has the same
scenes, in which a policy acts instead of a classifier.
"""

from dataclasses import replace

import numpy as np

from collectors.simulation.centering import CenteringConfig, Scene, draw_scene
from collectors.simulation.linear import length
from collectors.simulation.world import World
from collectors.tasks.gripper import Gripper, Moves, nearest_turn
from collectors.tasks.task import Task

CENTRED = 0.005  # [m] largest horizontal distance between TCP and block centre
AROUND = 0.01  # [m] by which the fingertips must be below the block's top
SPREAD = 0.004  # [m] standard deviation, at noise 1, of the point where the finger comes down


class BlockCentering(Task):
    """Task to touch a block with one finger, and then to lower the open gripper around the block, centred."""

    scene: Scene

    @classmethod
    def draw(cls, rng: np.random.Generator, world: World) -> Scene:
        """Draw a scene like those of the labelled samples, with the four directions equally likely."""
        return draw_scene(rng, int(rng.integers(4)), CenteringConfig(), world)

    def __init__(self, world: World, scene: Scene) -> None:
        """Put the block on the table."""
        self.world, self.scene = world, scene
        half = scene.block_half
        self.body = world.add_box(
            (half, half, half), (*scene.block_xy, half), scene.block_yaw, scene.block_mass, scene.block_friction,
            scene.block_color,
        )  # fmt: skip

    def success(self) -> bool:
        """Return whether the gripper is around the block.

        The TCP must be within 5 mm of the block's centre, horizontally, and the fingertips more than 1 cm below the
        block's top.
        """
        block, tcp = self.world.pose(self.body), self.world.tcp
        depth = block[2] + self.scene.block_half - (tcp[2] - self.world.fingers.tip)
        return bool(length(block[:2] - tcp[:2]) < CENTRED and depth > AROUND)

    def expert(self, gripper: Gripper) -> Moves:
        """Yield actions that hit the block with one finger, rise, turn to the block's yaw over its centre and go down.

        Args:
            gripper: Gripper of the task's world, which makes the actions.
        """
        scene = replace(self.scene, gripper_xy=tuple(gripper.vary(self.scene.gripper_xy, SPREAD)))
        touchdown = 2 * scene.block_half + self.world.fingers.tip
        yield from gripper.go(*scene.gripper_xy, touchdown + 0.03, scene.gripper_yaw)
        yield from gripper.go(z=touchdown - scene.push, speed=0.5, exact=True)
        while True:
            yield from gripper.go(z=touchdown + 0.02)
            x, y, *_ = pose = self.world.pose(self.body)
            theta = nearest_turn(self.world.yaw(self.body), np.pi / 2, near=self.world.target[3])
            yield from gripper.go(x, y, touchdown + 0.01, theta)
            yield from gripper.go(z=pose[2], speed=0.7, exact=True)
            yield from gripper.rest(2)
