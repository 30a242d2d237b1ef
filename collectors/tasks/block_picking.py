"""Block picking: lift a cube off the table."""

from dataclasses import dataclass
from functools import partial

import numpy as np

from collectors.simulation.linear import length
from collectors.simulation.world import World
from collectors.tasks.gripper import Gripper, Moves, nearest_turn
from collectors.tasks.task import Task

LIFTED = (
    0.1  # [m] height above the table position: as high as the reference benchmark's block at a gripper height of 0.15 m
)
CLEAR = 0.02  # [m] from an object up to the TCP of a gripper that moves over it without dragging it along
MARGIN = 0.05  # [m] from the block's centre to the workspace's border, at least


@dataclass(frozen=True)
class Scene:
    """Scene that is drawn for an episode, in the ranges of the reference benchmark, which the paper uses.

    Attributes:
        xy: Centre of the block in base, (x, y), [m].
        yaw: Yaw of the block, [rad].
        half: Half the block's edge, [m]. The block is a 5 cm cube scaled by 0.75 to 1.25.
        mass: Mass of the block, [kg]: 0.05 to 0.15 kg.
        friction: Coulomb friction of the block, 0.2 to 0.4. The fingers have 1, the table has 0.5, and a contact has
            the product of both bodies' values.
    """

    xy: tuple[float, float]
    yaw: float
    half: float
    mass: float
    friction: float


class BlockPicking(Task):
    """Task to grasp a cube of varying place, yaw, size, mass and friction, and to lift it by 10 cm."""

    scene: Scene

    @classmethod
    def draw(cls, rng: np.random.Generator, world: World) -> Scene:
        """Draw a scene with the block anywhere on the table in the workspace."""
        x, y = rng.uniform(world.workspace[:2, 0] + MARGIN, world.workspace[:2, 1] - MARGIN)
        return Scene(
            xy=(float(x), float(y)),
            yaw=float(rng.uniform(-np.pi / 4, np.pi / 4)),
            half=float(0.025 * rng.uniform(0.75, 1.25)),
            mass=float(rng.uniform(0.05, 0.15)),
            friction=float(rng.uniform(0.2, 0.4)),
        )

    def __init__(self, world: World, scene: Scene) -> None:
        """Put the block on the table."""
        self.world, self.scene = world, scene
        half = scene.half
        self.body = world.add_box(
            (half, half, half), (*scene.xy, half), scene.yaw, scene.mass, scene.friction, self.color
        )

    def success(self) -> bool:
        """Return whether both fingers press on the block and it is more than 10 cm higher than on the table."""
        return self.world.holds(self.body) and self.world.pose(self.body)[2] - self.scene.half > LIFTED

    def expert(self, gripper: Gripper) -> Moves:
        """Yield actions that move over the block, go down, close the fingers and lift the block.

        The expert starts again if the block slips or is no longer where it was.

        Args:
            gripper: Gripper of the task's world, which makes the actions.
        """
        while True:
            x, y, z, *_ = pose = self.world.pose(self.body)
            theta = nearest_turn(self.world.yaw(self.body), np.pi / 2, near=self.world.target[3])
            top = z + self.scene.half
            yield from gripper.go(z=max(self.world.target[2], top + CLEAR))
            yield from gripper.go(x, y, top + 0.05, theta, loose=True)
            yield from gripper.go(x, y, top + 0.015, theta)
            yield from gripper.go(z=max(z - 0.005, 0.012), exact=True, until=partial(self._astray, pose))
            if not self._astray(pose):
                yield from gripper.grip(0.0, travels=1.25, until=self._held)
                yield from gripper.go(z=z + LIFTED + 0.03, until=lambda: not self._held())
            yield from gripper.grip(1.0, travels=0.5)

    def _held(self) -> bool:
        return self.world.holds(self.body)

    def _astray(self, expected: np.ndarray) -> bool:
        """Return whether the block has moved from the pose `expected` at which the gripper goes down to grasp it."""
        return length(self.world.pose(self.body)[:3] - expected[:3]) > 0.01
