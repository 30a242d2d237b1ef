"""Block centering in simulation: which scenes are drawn, and the label of one.

The gripper comes down beside the block's centre so that exactly one finger lands on top of it, as after a grasp that is
slightly off (Kohler et al., CoRL 2023, appendix "Block Centering"). Felt at the wrist this is an upward force with a
lever arm along the finger axis; the displacement that would mend the grasp points along the same axis.
"""

import math
from dataclasses import dataclass

import numpy as np

from collectors.simulation.bounds import Degrees, NotNegative, PositiveRange
from collectors.simulation.world import World
from svfl_data.symmetry import OFFSET_PARTS, act, border_distance, element, nearest_direction

# Shape of pybullet_data's franka_panda finger (meshes/collision/finger.obj, fully open), relative to the TCP.
FINGER_SPAN = (0.040, 0.054)  # [m] inner and outer face along the finger axis
FINGERTIP = 0.0072  # [m] tip below the TCP
OVERLAP = 0.005  # [m] that the finger reaches over the block at least, and the other one stays clear of it


@dataclass(frozen=True)
class CenteringConfig:
    """How scenes are drawn.

    Attributes:
        border_deg: Directions closer than this to the border of two classes are not drawn, [deg]; 0 is the hard
            version.
        block_half: Bounds of half the block's edge, [m]; the paper scales a 5 cm cube by 0.75 to 1.25.
        block_mass: Bounds, [kg].
        block_friction: Bounds of the lateral friction coefficient.
        block_turn_deg: Largest yaw of the block against the gripper, [deg].
        lateral: Bounds of the distance between TCP and block centre, [m], narrowed to where one finger lands.
        sideways_deg: Largest angle between the finger axis and the direction to the block's centre, [deg].
        push: Bounds of the commanded depth of the fingertips below the block's top, [m].
        margin: Distance of the block's centre from the border of the workspace, [m].
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
    """One drawn scene; positions and angles in base axes.

    Attributes:
        block_xy: Centre of the block, [m].
        block_half: Half its edge, [m].
        block_yaw: Its yaw, [rad].
        block_mass: [kg].
        block_friction: Lateral friction coefficient.
        block_color: Red, green, blue, 0 to 1.
        gripper_xy: Where the gripper comes down, [m].
        gripper_yaw: With which yaw, [rad].
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
        rng: Source of all randomness.
        direction: Class 0..3 (`svfl_data.symmetry.DIRECTIONS`).
        config: Bounds of everything that is drawn.
        world: For its workspace and camera axes.

    Returns:
        The scene.
    """
    spread = 45 - config.border_deg
    in_image = 90 * direction + rng.uniform(-spread, spread)  # [deg], direction from TCP to block
    to_block = world.camera.image_axes.T @ element(in_image)[:, 0]  # base axes
    finger_axis = element(rng.uniform(-config.sideways_deg, config.sideways_deg)) @ to_block
    # The gripper looks the same after half a turn: take the yaw in (-90, 90] degrees, which the wrist reaches.
    yaw = (math.atan2(-finger_axis[0], finger_axis[1]) + np.pi / 2) % np.pi - np.pi / 2

    half, turn = rng.uniform(*config.block_half), rng.uniform(-1, 1) * np.deg2rad(config.block_turn_deg)
    extent = half * (math.cos(turn) + math.sin(abs(turn)))  # of the turned square along the finger axis
    inner, outer = FINGER_SPAN
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
    """Where the gripper must move, from the true poses.

    Attributes:
        offset: Block centre minus TCP, shape (2,), [m], base axes.
        direction: Nearest direction in image-aligned axes, 0..3.
        border_deg: Angle between the offset and the nearest border of two classes, [deg].
    """

    offset: np.ndarray
    direction: int
    border_deg: float


def true_label(world: World, block: int) -> Label:
    """Read the label off the true poses of block and gripper."""
    offset = world.pose(block)[:2] - world.tcp[:2]
    in_image = act(world.camera.image_axes, offset, OFFSET_PARTS)
    return Label(offset, int(nearest_direction(in_image)), float(np.rad2deg(border_distance(in_image))))
