"""The UR5e is built as its published tables say."""

import numpy as np
import pybullet
import pytest

from collectors.robots import make
from collectors.simulation import CameraConfig, NoiseConfig, World, WorldConfig
from collectors.simulation.arms.ur5e import LINKS
from collectors.simulation.grippers import robotiq_2f85
from collectors.simulation.urdf import UrdfBox, UrdfCylinder

# Universal Robots, "DH Parameters for calculations of kinematics and dynamics": a, d [m], alpha [rad], mass [kg],
# centre of mass in the frame at the link's end [m].
TABLE = (
    (0.0, 0.1625, np.pi / 2, 3.761, (0, -0.02561, 0.00193)),
    (-0.425, 0.0, 0.0, 8.058, (0.2125, 0, 0.11336)),
    (-0.3922, 0.0, 0.0, 2.846, (0.15, 0.0, 0.0265)),
    (0.0, 0.1333, np.pi / 2, 1.37, (0, -0.0018, 0.01634)),
    (0.0, 0.0997, -np.pi / 2, 1.3, (0, 0.0018, 0.01634)),
    (0.0, 0.0996, 0.0, 0.365, (0, 0, -0.001159)),
)


@pytest.fixture(scope="module")
def world():
    camera = CameraConfig(height=24, width=24)
    config = WorldConfig(robot=make("ur5e_sim"), noise=NoiseConfig.none(), cameras={"front": camera})
    with World(config) as world:
        world.reset(seed=0)
        yield world


def ends(joints) -> list[np.ndarray]:
    """Pose of the frame at the end of every link in base, (4, 4), by the standard Denavit-Hartenberg convention."""
    pose, found = np.eye(4), []
    for (a, d, alpha, _, _), theta in zip(TABLE, joints, strict=True):
        c, s, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
        pose = pose @ [[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]]
        found.append(pose)
    return found


@pytest.mark.parametrize("seed", range(3))
def test_every_link_is_where_the_table_puts_it(world, seed):
    joints = np.random.default_rng(seed).uniform(-np.pi, np.pi, 6)
    world.reset(seed=0)
    for joint, angle in enumerate(joints):
        pybullet.resetJointState(world.robot, joint, angle, physicsClientId=world.client)
    for link, (pose, (*_, mass, centre)) in enumerate(zip(ends(joints), TABLE, strict=True)):
        assert pybullet.getDynamicsInfo(world.robot, link, physicsClientId=world.client)[0] == mass
        state = pybullet.getLinkState(world.robot, link, computeForwardKinematics=True, physicsClientId=world.client)
        np.testing.assert_allclose(state[0], (pose @ [*centre, 1.0])[:3], atol=1e-6)
    flange = pybullet.getLinkState(
        world.robot, world.sensor_joint, computeForwardKinematics=True, physicsClientId=world.client
    )
    np.testing.assert_allclose(flange[4], ends(joints)[-1][:3, 3], atol=1e-6)
    axes = np.reshape(pybullet.getMatrixFromQuaternion(flange[5]), (3, 3))
    np.testing.assert_allclose(axes, ends(joints)[-1][:3, :3], atol=1e-6)


def test_the_gripper_weighs_and_opens_as_stated(world):
    world.reset(seed=0)
    links = (world.sensor_joint, *world.finger_links)
    masses = [pybullet.getDynamicsInfo(world.robot, link, physicsClientId=world.client)[0] for link in links]
    states = [pybullet.getLinkState(world.robot, link, physicsClientId=world.client) for link in links]
    np.testing.assert_allclose(sum(masses), 0.925)
    centre = np.average([state[0] for state in states], axis=0, weights=masses)
    np.testing.assert_allclose(states[0][4] - centre, [0, 0, 0.058], atol=1e-6)
    np.testing.assert_allclose(world.tcp[2] - world.fingers.tip, states[0][4][2] - 0.1628, atol=1e-6)
    left, right = (np.array(state[4]) for state in states[1:])
    np.testing.assert_allclose(right - left, [0, 0.085, 0], atol=1e-4)


def test_moments_of_inertia_are_those_of_uniform_solids():
    """Against points spread over the solid; the sixth link is so small that what it has does not matter."""
    box, cylinder = UrdfBox((0.2, 0.1, 0.4)), UrdfCylinder(0.1, 0.5, "x")
    rng = np.random.default_rng(0)
    points = rng.uniform(-0.5, 0.5, (200_000, 3))
    round_points = points[np.hypot(points[:, 1], points[:, 2]) < 0.5] * [0.5, 0.2, 0.2]
    for solid, spread in ((box, points * box.size), (cylinder, round_points)):
        squares = (spread**2).mean(axis=0)
        np.testing.assert_allclose(solid.inertia(2.0), 2.0 * (squares.sum() - squares), rtol=0.01)


def test_no_posture_of_the_workspace_is_singular(world):
    """The smallest singular value of the Jacobian of the TCP, in [m] and [rad], everywhere and at any yaw."""
    world.reset(seed=0)
    smallest = []
    for x in world.workspace[0]:
        for y in (*world.workspace[1], 0.0):
            for z in world.workspace[2]:
                for theta in (-np.pi / 2, 0.0, np.pi / 2):
                    goal = np.array([x, y, z, theta])
                    while np.abs(goal - world.target).max() > 1e-9:
                        world.step([1.0, *(goal - world.target)])
                    smallest.append(np.linalg.svd(world._arm._jacobian, compute_uv=False)[-1])
    assert min(smallest) > 0.1


def test_the_table_of_the_code_is_the_published_one():
    assert [(one.a, one.d, one.mass, one.centre) for one in LINKS] == [(a, d, m, c) for a, d, _, m, c in TABLE]
    assert robotiq_2f85.MASS == 0.925
