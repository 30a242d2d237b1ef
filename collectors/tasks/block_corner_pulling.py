"""Block corner pulling: pull a cube out of a corner where no finger gets behind it."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from collectors.simulation.bodies import Box
from collectors.simulation.centering import FINGERTIP
from collectors.simulation.world import World
from collectors.tasks.gripper import Gripper, Moves, nearest_turn
from collectors.tasks.task import Task

OUT = 0.05  # [m] along a wall from where the cube was, more than: its largest edge, so that a finger fits behind it
PLATE = 0.075  # [m], half the edge of the fixture's square plate
THICK = 0.01  # [m] of plate and walls
WALL = 0.05  # [m] of the walls above the plate: as high as the largest cube, so that none can be grasped
MARGIN = 0.11  # [m] of the plate's middle from the workspace's border, at least: all of the fixture is inside
FIXTURE_COLOR = (0.85, 0.8, 0.7)
OVER = 0.015  # [m] of the fingertips above the cube before pressing
PRESS = 0.010  # [m] of the command below contact: 25 N
FAR = 0.075  # [m] to drag along each wall
SLIPPED = 0.012  # [m] of the gripper over the cube, when the fingers slide on it


@dataclass(frozen=True)
class Scene:
    """What is drawn; the paper says what varies, the ranges are those of block pushing or lie around the reference's.

    Attributes:
        xy: Middle of the fixture's plate, [m].
        yaw: Yaw of the fixture and the cube, [rad]; the walls stand at the plate's -x and -y edges in its own axes.
        gap: Between cube and walls along the fixture's x and y, [m]: 0.5 to 3 mm.
        half: Half the cube's edge, [m]: 5 cm scaled by 0.75 to 1.
        mass: Of the cube, 0.1 to 0.3 kg (reference 0.2).
        friction: Coulomb friction of the cube, 0.6 to 0.9 (reference 0.75).
        fixture_friction: Coulomb friction of the fixture, 0.3 to 0.7 (reference: PyBullet's 0.5).
    """

    xy: tuple[float, float]
    yaw: float
    gap: tuple[float, float]
    half: float
    mass: float
    friction: float
    fixture_friction: float


class BlockCornerPulling(Task):
    """Pull a cube of varying size, mass and friction out of the corner of a fixture of varying place, yaw and friction.

    Walls on two sides keep the fingers from getting behind it or around it: they must press on its top and drag.
    """

    scene: Scene
    fixture: int

    @classmethod
    def draw(cls, rng: np.random.Generator, world: World) -> Scene:
        """The fixture anywhere inside the workspace, in all directions."""
        x, y = rng.uniform(world.workspace[:2, 0] + MARGIN, world.workspace[:2, 1] - MARGIN)
        first, second = rng.uniform(0.0005, 0.003, 2).tolist()
        return Scene(
            xy=(float(x), float(y)),
            yaw=float(rng.uniform(-np.pi, np.pi)),
            gap=(first, second),
            half=float(0.025 * rng.uniform(0.75, 1.0)),
            mass=float(rng.uniform(0.1, 0.3)),
            friction=float(rng.uniform(0.6, 0.9)),
            fixture_friction=float(rng.uniform(0.3, 0.7)),
        )

    def __init__(self, world: World, scene: Scene) -> None:
        """Fix the fixture to the table, and put the cube into its corner."""
        self.world, self.scene = world, scene
        half, middle = scene.half, THICK + WALL / 2
        walls = (
            Box((THICK / 2, PLATE, WALL / 2), (-PLATE + THICK / 2, 0.0, middle), color=FIXTURE_COLOR),
            Box((PLATE - THICK / 2, THICK / 2, WALL / 2), (THICK / 2, -PLATE + THICK / 2, middle), color=FIXTURE_COLOR),
        )
        plate = Box((PLATE, PLATE, THICK / 2), (0.0, 0.0, THICK / 2), color=FIXTURE_COLOR)
        self.fixture = world.bodies.add([plate, *walls], (*scene.xy, 0.0), scene.yaw, friction=scene.fixture_friction)
        cos, sin = math.cos(scene.yaw), math.sin(scene.yaw)
        self._axes = np.array([[cos, -sin], [sin, cos]])  # columns: the fixture's x and y in base
        self._seat = np.array(scene.xy) + self._axes @ (np.array(scene.gap) + half + THICK - PLATE)
        self.body = world.add_box(
            (half, half, half), (*self._seat, THICK + half), scene.yaw, scene.mass, scene.friction, self.color
        )

    def success(self) -> bool:
        """The cube's centre has moved by more than 5 cm, horizontally, along the fixture's x or y or both.

        That is along one wall, or diagonally away from both. It may not be above where it lay.
        """
        moved = self._axes.T @ (self.world.pose(self.body)[:2] - self._seat)
        lifted = self.world.pose(self.body)[2] - (THICK + self.scene.half)
        return bool(moved.max() > OUT and lifted < THICK)

    def state(self) -> Mapping[str, np.ndarray]:
        """The cube's pose, and the fixture's, (7,)."""
        return {**super().state(), "fixture": self.world.pose(self.fixture)}

    def expert(self, gripper: Gripper) -> Moves:
        """Press closed fingers on the cube's top and drag it out between the walls; again if they slip."""
        yield from gripper.grip(0.0, steps=0)
        while True:
            *middle, z = self.world.pose(self.body)[:3]
            touch = z + self.scene.half + FINGERTIP
            theta = nearest_turn(self.world.yaw(self.body), np.pi / 2)
            yield from gripper.go(z=max(self.world.target[2], touch + OVER))
            x, y = gripper.vary(middle, 0.0015)
            yield from gripper.go(x, y, touch + OVER, theta)
            pressed = self.world.target[:2] - middle
            yield from gripper.go(z=touch - float(gripper.vary(PRESS, 0.001)), speed=0.3, exact=True)
            goal = self._seat + self._axes @ gripper.vary((FAR, FAR), 0.01)
            yield from gripper.go(*goal, speed=0.7, exact=True, until=partial(self._slipped, pressed))

    def _slipped(self, pressed: np.ndarray) -> bool:
        """Whether the gripper is no longer where it pressed on the cube, `pressed` from its centre."""
        return bool(np.linalg.norm(self.world.tcp[:2] - self.world.pose(self.body)[:2] - pressed) > SLIPPED)
