"""Block picking: lift a cube off the table."""

from dataclasses import dataclass
from functools import partial

import numpy as np

from collectors.simulation.world import World
from collectors.tasks.gripper import Gripper, Moves, nearest_turn
from collectors.tasks.task import Task

LIFTED = (
    0.1  # [m] above where it lay: the block then is where the reference benchmark's is at a gripper height of 0.15 m
)
CLEAR = 0.02  # [m] between the TCP of a travelling gripper and what it might drag along
MARGIN = 0.05  # [m] from the workspace's border, at least


@dataclass(frozen=True)
class Scene:
    """What is drawn (ranges of the reference benchmark, which the paper uses).

    Attributes:
        xy: Centre of the block, [m].
        yaw: Its yaw, [rad].
        half: Half its edge, [m]: a 5 cm cube scaled by 0.75 to 1.25.
        mass: 0.05 to 0.15 kg.
        friction: Its Coulomb friction, 0.2 to 0.4; the fingers have 1, the table 0.5, contact has the product.
    """

    xy: tuple[float, float]
    yaw: float
    half: float
    mass: float
    friction: float


class BlockPicking(Task):
    """Grasp a cube of varying place, yaw, size, mass and friction, and lift it by 10 cm."""

    scene: Scene

    @classmethod
    def draw(cls, rng: np.random.Generator, world: World) -> Scene:
        """Anywhere on the workspace's table."""
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
        """Both fingers press on the block, and it is 10 cm higher than on the table."""
        return self.world.holds(self.body) and self.world.pose(self.body)[2] - self.scene.half > LIFTED

    def expert(self, gripper: Gripper) -> Moves:
        """Over the block, down, close, up; again if it slips or is not where it was."""
        while True:
            x, y, z, *_ = pose = self.world.pose(self.body)
            theta = nearest_turn(self.world.yaw(self.body), np.pi / 2, near=self.world.target[3])
            top = z + self.scene.half
            yield from gripper.go(z=max(self.world.target[2], top + CLEAR))
            yield from gripper.go(x, y, top + 0.05, theta, loose=True)
            yield from gripper.go(x, y, top + 0.015, theta)
            yield from gripper.go(z=max(z - 0.005, 0.012), exact=True, until=partial(self._astray, pose))
            if not self._astray(pose):
                yield from gripper.grip(0.0, steps=5, until=self._held)
                yield from gripper.go(z=z + LIFTED + 0.03, until=lambda: not self._held())
            yield from gripper.grip(1.0, steps=2)

    def _held(self) -> bool:
        return self.world.holds(self.body)

    def _astray(self, expected: np.ndarray) -> bool:
        """Whether the block is no longer where the gripper goes down for it."""
        return bool(np.linalg.norm(self.world.pose(self.body)[:3] - expected[:3]) > 0.01)
