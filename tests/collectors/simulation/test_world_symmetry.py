"""The simulated world is as symmetric as the networks say: a turned or mirrored scene is felt turned or mirrored.

Block, gripper and actions are moved by a group element about the workspace centre; the arm's base stays where it is, so
that arm postures and dynamics differ. What the wrist feels in base axes must then move as `svfl_data.symmetry` says:
force as a vector, torque as an axial vector, m_z with the sign of the determinant. This is the proof on physics, not on
formulas, that a torque is axial: the polar law is off by far more than the tolerance for every reflection.
"""

from collections.abc import Sequence

import numpy as np
import pytest

from collectors.robots import OWN, make
from collectors.simulation import CameraConfig, NoiseConfig, World, WorldConfig
from svfl_data.symmetry import ACTION_PARTS, WRENCH_PARTS, Part, act, element
from tests.helpers.worlds import hold, move

pytestmark = pytest.mark.slow

HALF = 0.025
TOP = 2 * HALF + 0.0072  # TCP height at which a fingertip reaches the block's top
ELEMENTS = [(90 * k, flip) for flip in (False, True) for k in range(4)][1:]
# Of the largest force and torque of the episode, root mean square over its readings. What is left is friction: a
# sticking finger keeps a sideways force of 1 to 2 N, and a grasp one of 0.5 N, that depends on how the arm, in another
# posture, gave way before.
FORCE_TOLERANCE, TORQUE_TOLERANCE = 0.10, 0.16

PRESS = [(1, 0, 0, -0.002, 0)] * 8 + [(1, 0, 0, 0, 0)] * 4
PUSH = [(1, 0.006, 0.003, -0.001, 0.0)] * 4 + [(1, 0, 0, 0, 0.04)] * 4
GRASP = [(0, 0, 0, 0, 0)] * 6 + [(0, 0, 0, 0.01, 0)] * 4 + [(0, 0.004, -0.008, 0, 0.05)] * 4
# Offset of the block from the workspace centre, of the gripper from the block [m], yaw of gripper and block [rad],
# TCP height [m], and what is done from there.
SCENES = {
    "one finger presses beside the middle": ((0.06, 0.03), (0.012, 0.040), 0.25, 0.1, TOP + 0.005, PRESS),
    "a finger presses, drags and twists": ((0.03, -0.07), (-0.008, 0.042), -0.3, -0.2, TOP + 0.005, PRESS + PUSH),
    "a grasped block is lifted and turned": ((-0.05, 0.06), (0.004, 0.003), 0.4, 0.4, 0.02, GRASP),
}


def turned(matrix: np.ndarray, angle: float) -> float:
    """A gripper's or block's yaw under a group element, in (-pi/2, pi/2]: both look the same after half a turn."""
    moved = np.linalg.det(matrix) * angle + np.arctan2(matrix[1, 0], matrix[0, 0])
    return float(np.pi / 2 - (np.pi / 2 - moved) % np.pi)


def feel(world: World, matrix: np.ndarray, scene: Sequence) -> np.ndarray:
    """Tared wrench of a scene moved by a group element, from the first action on, base axes, (M, 6)."""
    block_offset, gripper_offset, gripper_yaw, block_yaw, height, actions = scene
    centre = world.workspace[:2].mean(axis=1)
    block_xy = centre + matrix @ block_offset
    gripper_xy = centre + matrix @ np.add(block_offset, gripper_offset)
    yaw = turned(matrix, gripper_yaw)
    world.reset(seed=0)
    block = (*block_xy, HALF), turned(matrix, block_yaw)
    move(world, (*gripper_xy, 0.12, yaw))
    world.add_box((HALF, HALF, HALF), *block, mass=0.1, friction=0.8)
    move(world, (*gripper_xy, height, yaw), stride=0.5)
    hold(world, 8)
    world.tare()
    begun = len(world.wrench)
    for action in actions:
        world.step(act(matrix, np.array(action, float), ACTION_PARTS))
    return world.wrench[begun:] - world.tare_offset


def errors(felt: np.ndarray, expected: np.ndarray) -> tuple[float, float]:
    """Root mean square difference of force and of torque, relative to the largest of the episode."""
    parts = []
    for part in (slice(0, 3), slice(3, 6)):
        difference = np.linalg.norm((felt - expected)[:, part], axis=1)
        parts.append(float(np.sqrt(np.mean(difference**2)) / np.linalg.norm(expected[:, part], axis=1).max()))
    return parts[0], parts[1]


@pytest.fixture(scope="module", params=OWN)
def world(request):
    camera = CameraConfig(height=24, width=24)
    with World(WorldConfig(robot=make(request.param), noise=NoiseConfig.none(), cameras={"front": camera})) as world:
        yield world


@pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES)
def test_a_moved_scene_is_felt_moved(world, scene):
    original = feel(world, np.eye(2), scene)
    assert np.abs(original[:, :3]).max() > 3.0
    for degrees, flip in ELEMENTS:
        matrix = element(degrees, flip)
        force, torque = errors(feel(world, matrix, scene), act(matrix, original, WRENCH_PARTS))
        assert force < FORCE_TOLERANCE, (degrees, flip)
        assert torque < TORQUE_TOLERANCE, (degrees, flip)


POLAR = (Part("vector", (0, 1)), Part("invariant", (2,)), Part("vector", (3, 4)), Part("invariant", (5,)))


def test_physics_refutes_the_polar_torque(world):
    """The published typing fits rotations and fails for every reflection."""
    scene = SCENES["one finger presses beside the middle"]
    original = feel(world, np.eye(2), scene)
    for degrees, flip in ELEMENTS:
        matrix = element(degrees, flip)
        _, torque = errors(feel(world, matrix, scene), act(matrix, original, POLAR))
        assert (torque > 1.0) == flip, (degrees, flip)
