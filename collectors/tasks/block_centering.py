"""Block centering as an environment: after one finger has hit the block, take the gripper to where it can grasp.

The labelled samples of the paper's classification task come from ``svfl-collect centering``; this is the same scene, to
be solved instead of classified.
"""

from dataclasses import replace

import numpy as np

from collectors.simulation.centering import FINGERTIP, CenteringConfig, Scene, draw_scene
from collectors.simulation.world import World
from collectors.tasks.gripper import Gripper, Moves, nearest_turn
from collectors.tasks.task import Task

CENTRED = 0.005  # [m] horizontally between TCP and block centre, at most
AROUND = 0.01  # [m] that the fingertips must be below the block's top
SPREAD = 0.004  # [m] of where the finger comes down, at noise 1, standard deviation


class BlockCentering(Task):
    """Feel with one finger where the block is, then bring the open gripper around it, centred."""

    scene: Scene

    @classmethod
    def draw(cls, rng: np.random.Generator, world: World) -> Scene:
        """As for the samples, the four directions equally likely."""
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
        """The TCP is within 5 mm of the block's centre, horizontally, and the fingertips are 1 cm below its top."""
        block, tcp = self.world.pose(self.body), self.world.tcp
        depth = block[2] + self.scene.block_half - (tcp[2] - FINGERTIP)
        return bool(np.linalg.norm(block[:2] - tcp[:2]) < CENTRED and depth > AROUND)

    def expert(self, gripper: Gripper) -> Moves:
        """Down beside the centre until a finger has hit the block, up, over the centre with the block's yaw, down."""
        scene = replace(self.scene, gripper_xy=tuple(gripper.vary(self.scene.gripper_xy, SPREAD)))
        touchdown = 2 * scene.block_half + FINGERTIP
        yield from gripper.go(*scene.gripper_xy, touchdown + 0.03, scene.gripper_yaw)
        yield from gripper.go(z=touchdown - scene.push, speed=0.5, exact=True)
        while True:
            yield from gripper.go(z=touchdown + 0.02)
            x, y, *_ = pose = self.world.pose(self.body)
            theta = nearest_turn(self.world.yaw(self.body), np.pi / 2, near=self.world.target[3])
            yield from gripper.go(x, y, touchdown + 0.01, theta)
            yield from gripper.go(z=pose[2], speed=0.7, exact=True)
            yield from gripper.rest(2)
