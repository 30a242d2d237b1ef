"""Block corner pulling: pull a cube out of a corner where no finger gets behind the cube."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from collectors.simulation.bodies import Box
from collectors.simulation.linear import length, product
from collectors.simulation.world import World
from collectors.tasks.gripper import Gripper, Moves, nearest_turn
from collectors.tasks.task import Task

OUT = 0.05  # [m] by which the cube must move along a wall: its largest edge, so that a finger fits behind it
PLATE = 0.075  # [m] half the edge of the fixture's square plate
THICK = 0.01  # [m] thickness of the plate and the walls
WALL = 0.05  # [m] height of the walls above the plate: as high as the largest cube, so that no cube can be grasped
MARGIN = 0.11  # [m] from the plate's middle to the workspace's border, at least: all of the fixture is inside
FIXTURE_COLOR = (0.85, 0.8, 0.7)
OVER = 0.015  # [m] height of the fingertips above the cube before they press
PRESS = 0.010  # [m] depth of the command below contact, which presses with 25 N
FAR = 0.075  # [m] way to drag the cube along each wall
SLIPPED = 0.012  # [m] by which the gripper moves over the cube when the fingers slide on it


@dataclass(frozen=True)
class Scene:
    """Scene that is drawn for an episode.

    The paper says which numbers vary. Their ranges are those of block pushing or lie around the values of the reference
    benchmark.

    Attributes:
        xy: Middle of the fixture's plate in base, (x, y), [m].
        yaw: Yaw of the fixture and the cube, [rad]. In the fixture's axes the walls stand at the plate's -x and -y
            edges.
        gap: Gaps between cube and walls along the fixture's x and y, [m]: 0.5 to 3 mm.
        half: Half the cube's edge, [m]. The edge is 5 cm scaled by 0.75 to 1.
        mass: Mass of the cube, [kg]: 0.1 to 0.3 kg (reference benchmark: 0.2).
        friction: Coulomb friction of the cube, 0.6 to 0.9 (reference benchmark: 0.75).
        fixture_friction: Coulomb friction of the fixture, 0.3 to 0.7 (reference benchmark: PyBullet's 0.5).
    """

    xy: tuple[float, float]
    yaw: float
    gap: tuple[float, float]
    half: float
    mass: float
    friction: float
    fixture_friction: float


class BlockCornerPulling(Task):
    """Task to pull a cube out of the corner of a fixture.

    The cube varies in size, mass and friction, and the fixture in place, yaw and friction. Walls on two sides keep the
    fingers from getting behind or around the cube, so the fingers must press on its top and drag it.

    Attributes:
        fixture: Body id of the fixture.
    """

    scene: Scene
    fixture: int

    @classmethod
    def draw(cls, rng: np.random.Generator, world: World) -> Scene:
        """Draw a scene with the fixture anywhere inside the workspace and with any yaw."""
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
        """Fix the fixture to the table, and put the cube into the fixture's corner."""
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
        self._seat = np.array(scene.xy) + product(self._axes, np.array(scene.gap) + half + THICK - PLATE)
        self.body = world.add_box(
            (half, half, half), (*self._seat, THICK + half), scene.yaw, scene.mass, scene.friction, self.color
        )

    def success(self) -> bool:
        """Return whether the cube's centre has moved by more than 5 cm, horizontally, along the fixture's x or y.

        So the cube may move along one wall or diagonally away from both. It must be less than 1 cm higher than at the
        start.
        """
        moved = product(self._axes.T, self.world.pose(self.body)[:2] - self._seat)
        lifted = self.world.pose(self.body)[2] - (THICK + self.scene.half)
        return bool(moved.max() > OUT and lifted < THICK)

    def state(self) -> Mapping[str, np.ndarray]:
        """Return the poses of the cube and of the fixture in base, each (7,): position [m] and quat_xyzw."""
        return {**super().state(), "fixture": self.world.pose(self.fixture)}

    def expert(self, gripper: Gripper) -> Moves:
        """Yield actions that press closed fingers on the cube's top and drag the cube out between the walls.

        The expert starts again if the fingers slip on the cube.

        Args:
            gripper: Gripper of the task's world, which makes the actions.
        """
        yield from gripper.grip(0.0, travels=0)
        while True:
            *middle, z = self.world.pose(self.body)[:3]
            touch = z + self.scene.half + self.world.fingers.tip
            theta = nearest_turn(self.world.yaw(self.body), np.pi / 2)
            yield from gripper.go(z=max(self.world.target[2], touch + OVER))
            x, y = gripper.vary(middle, 0.0015)
            yield from gripper.go(x, y, touch + OVER, theta)
            pressed = self.world.target[:2] - middle
            yield from gripper.go(z=touch - float(gripper.vary(PRESS, 0.001)), speed=0.3, exact=True)
            goal = self._seat + product(self._axes, gripper.vary((FAR, FAR), 0.01))
            yield from gripper.go(*goal, speed=0.7, exact=True, until=partial(self._slipped, pressed))

    def _slipped(self, pressed: np.ndarray) -> bool:
        """Return whether the TCP has left the point, `pressed` from the cube's centre, (2,), [m], that it pressed."""
        return length(self.world.tcp[:2] - self.world.pose(self.body)[:2] - pressed) > SLIPPED
