"""Block centering in simulation: how a scene is drawn, and the label of a scene.

The gripper comes down beside the block's centre so that exactly one finger lands on top of the block, as after a grasp
that is slightly off (Kohler et al., CoRL 2023, appendix "Block Centering"). The wrist sensor reads this as an upward
force with a lever arm along the finger axis. The displacement that would correct the grasp points along the same axis.
"""

import math
from dataclasses import dataclass

import numpy as np

from collectors.simulation.bounds import Degrees, NotNegative, PositiveRange
from collectors.simulation.linear import product
from collectors.simulation.world import World
from svfl_data.symmetry import OFFSET_PARTS, act, border_distance, element, nearest_direction

OVERLAP = 0.005  # [m] by which one finger at least reaches over the block, and the other at least stays clear of it


@dataclass(frozen=True)
class CenteringConfig:
    """Bounds of the random numbers from which a block centering scene is drawn.

    Attributes:
        border_deg: Smallest angle between a drawn direction and the border of two classes, [deg]; 0 is the hard
            version of the task.
        block_half: Bounds of half the block's edge, [m]; the paper scales a 5 cm cube by 0.75 to 1.25.
        block_mass: Bounds of the block's mass, [kg].
        block_friction: Bounds of the block's lateral friction coefficient.
        block_turn_deg: Largest yaw of the block relative to the gripper, [deg].
        lateral: Bounds of the horizontal distance between TCP and block centre, [m]. The distance is also kept in the
            range where exactly one finger lands on the block.
        sideways_deg: Largest angle between the finger axis and the direction to the block's centre, [deg].
        push: Bounds of the commanded depth of the fingertips below the block's top, [m].
        margin: Smallest distance of the block's centre from the border of the workspace, [m].
    """

    border_deg: Degrees = 5.0
    block_half: PositiveRange = (0.019, 0.031)
    block_mass: PositiveRange = (0.05, 0.15)
    block_friction: PositiveRange = (0.4, 1.0)
    block_turn_deg: Degrees = 20.0
    lateral: PositiveRange = (0.015, 0.055)
    sideways_deg: Degrees = 3.0
    push: PositiveRange = (0.004, 0.012)
    margin: NotNegative = 0.09


@dataclass(frozen=True)
class Scene:
    """One scene of block centering. Positions and angles are in base axes.

    Attributes:
        block_xy: Centre of the block, (x, y), [m].
        block_half: Half the edge of the block, [m].
        block_yaw: Yaw of the block, [rad].
        block_mass: Mass of the block, [kg].
        block_friction: Lateral friction coefficient of the block.
        block_color: RGB of the block, 0 to 1.
        gripper_xy: Point where the gripper comes down, (x, y), [m].
        gripper_yaw: Yaw of the gripper when it comes down, [rad].
        push: Commanded depth of the fingertips below the block's top, [m].
    """

    block_xy: tuple[float, float]
    block_half: float
    block_yaw: float
    block_mass: float
    block_friction: float
    block_color: tuple[float, float, float]
    gripper_xy: tuple[float, float]
    gripper_yaw: float
    push: float


def draw_scene(rng: np.random.Generator, direction: int, config: CenteringConfig, world: World) -> Scene:
    """Draw a scene in which the gripper must move in a given image-aligned direction.

    Args:
        rng: Source of all random numbers.
        direction: Class of the direction, 0..3 (`svfl_data.symmetry.DIRECTIONS`).
        config: Bounds of all numbers that are drawn.
        world: World whose workspace, fingers and image axes of the first camera are used. Nothing is put into the
            world.

    Returns:
        The scene.
    """
    spread = 45 - config.border_deg
    in_image = 90 * direction + rng.uniform(-spread, spread)  # [deg], direction from TCP to block
    to_block = product(world.camera.image_axes.T, element(in_image)[:, 0])  # base axes
    finger_axis = product(element(rng.uniform(-config.sideways_deg, config.sideways_deg)), to_block)
    # The gripper looks the same after half a turn: take the yaw in (-90, 90] degrees, which the wrist reaches.
    yaw = (math.atan2(-finger_axis[0], finger_axis[1]) + np.pi / 2) % np.pi - np.pi / 2

    half, turn = rng.uniform(*config.block_half), rng.uniform(-1, 1) * np.deg2rad(config.block_turn_deg)
    extent = half * (math.cos(turn) + math.sin(abs(turn)))  # half the width of the turned square along the finger axis
    inner, outer = world.fingers.stroke, world.fingers.outer
    nearest = max(abs(extent - inner) + OVERLAP, config.lateral[0])  # one finger lands, the other passes
    farthest = min(outer + extent - OVERLAP, config.lateral[1])
    block_xy = rng.uniform(world.workspace[:2, 0] + config.margin, world.workspace[:2, 1] - config.margin)
    gripper_xy = block_xy - rng.uniform(nearest, farthest) * to_block
    red, green, blue = rng.uniform(0.15, 0.9, 3)
    return Scene(
        block_xy=(float(block_xy[0]), float(block_xy[1])),
        block_half=float(half),
        block_yaw=float(yaw + turn),
        block_mass=float(rng.uniform(*config.block_mass)),
        block_friction=float(rng.uniform(*config.block_friction)),
        block_color=(float(red), float(green), float(blue)),
        gripper_xy=(float(gripper_xy[0]), float(gripper_xy[1])),
        gripper_yaw=float(yaw),
        push=float(rng.uniform(*config.push)),
    )


@dataclass(frozen=True)
class Label:
    """Displacement that centres the gripper over the block, computed from the true poses.

    Attributes:
        offset: Block centre minus TCP, (x, y), shape (2,), [m], base axes.
        direction: Class of the nearest direction in image-aligned axes, 0..3.
        border_deg: Angle between the offset and the nearest border of two classes, [deg].
    """

    offset: np.ndarray
    direction: int
    border_deg: float


def true_label(world: World, block: int) -> Label:
    """Compute the label from the true poses of the block and the gripper.

    Args:
        world: World that holds the block.
        block: Body id of the block.
    """
    offset = world.pose(block)[:2] - world.tcp[:2]
    in_image = act(world.camera.image_axes, offset, OFFSET_PARTS)
    return Label(offset, int(nearest_direction(in_image)), float(np.rad2deg(border_distance(in_image))))
