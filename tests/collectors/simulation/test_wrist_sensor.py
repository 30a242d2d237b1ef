"""Sign, axes and reference point of the wrist sensor, against known weights and known pushes."""

import numpy as np
import pybullet
import pytest

from collectors.simulation import World
from collectors.tasks.gripper import travel_steps
from tests.helpers.worlds import hold, move

pytestmark = pytest.mark.slow

GRIPPER = {"panda_sim": 0.81 + 2 * 0.1, "ur5e_sim": 0.925}  # [kg]: panda.urdf; Robotiq's manual
PLACES = [(0.55, 0.0, 0.2, 0.0), (0.4, 0.15, 0.1, 0.7), (0.7, -0.18, 0.15, -1.3)]


@pytest.fixture
def world(robot_world: World) -> World:
    return robot_world


def sensor_origin(world: World) -> np.ndarray:
    state = pybullet.getLinkState(world.robot, world.sensor_joint, physicsClientId=world.client)
    return np.array(state[4])  # origin of the gripper's frame = origin of its joint


def loaded_minus_unloaded(world: World, load) -> np.ndarray:
    hold(world, 12)
    before = world.wrench[-10:].mean(axis=0, dtype=np.float64)
    load()
    hold(world, 24)
    return world.wrench[-10:].mean(axis=0, dtype=np.float64) - before


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize(
    ("mass", "arm"), [(0.2, (0.0, 0.0, -0.1)), (0.5, (0.07, -0.05, -0.12)), (0.3, (-0.1, 0.1, 0.05))]
)
def test_a_hanging_mass_reads_its_weight(world: World, place, mass, arm):
    move(world, place)

    def hang():
        position = sensor_origin(world) + arm
        ball = pybullet.createMultiBody(mass, basePosition=position.tolist(), physicsClientId=world.client)
        pybullet.changeDynamics(ball, -1, linearDamping=0.0, angularDamping=0.0, physicsClientId=world.client)
        gripper = pybullet.getLinkState(world.robot, world.sensor_joint, physicsClientId=world.client)
        inverse = pybullet.invertTransform(gripper[0], gripper[1])  # centre-of-mass frame of the gripper
        anchor, _ = pybullet.multiplyTransforms(*inverse, position.tolist(), (0.0, 0.0, 0.0, 1.0))
        pybullet.createConstraint(
            world.robot, world.sensor_joint, ball, -1, pybullet.JOINT_POINT2POINT, (0, 0, 0), anchor, (0, 0, 0),
            physicsClientId=world.client,
        )  # fmt: skip
        world.ball = ball

    reading = loaded_minus_unloaded(world, hang)
    force = np.array([0.0, 0.0, -9.81 * mass])
    torque = np.cross(world.pose(world.ball)[:3] - sensor_origin(world), force)
    np.testing.assert_allclose(reading[:3], force, atol=0.01 * np.linalg.norm(force))
    np.testing.assert_allclose(reading[3:], torque, atol=0.01 * max(np.linalg.norm(torque), 0.1))


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize(
    ("force", "arm"),
    [
        ((8.0, 0.0, 0.0), (0.0, 0.0, -0.1)),
        ((0.0, -6.0, 0.0), (0.05, 0.0, -0.1)),
        ((3.0, 5.0, 10.0), (0.02, 0.06, -0.16)),
    ],
)
def test_a_push_reads_its_force_and_its_moment_about_the_sensor(world: World, monkeypatch, place, force, arm):
    move(world, place)
    simulate = pybullet.stepSimulation

    def push_and_simulate(physicsClientId: int) -> None:
        point = sensor_origin(world) + arm
        pybullet.applyExternalForce(
            world.robot, world.sensor_joint, force, point.tolist(), pybullet.WORLD_FRAME, physicsClientId=world.client
        )
        simulate(physicsClientId=physicsClientId)

    reading = loaded_minus_unloaded(world, lambda: monkeypatch.setattr(pybullet, "stepSimulation", push_and_simulate))
    np.testing.assert_allclose(reading[:3], force, atol=0.01 * np.linalg.norm(force))
    torque = np.cross(arm, force)
    np.testing.assert_allclose(reading[3:], torque, atol=0.01 * np.linalg.norm(torque))

    yielded = world.tcp[:3] - world.target[:3]
    expected = np.array(force) / world.config.admittance.stiffness
    np.testing.assert_allclose(yielded, expected, atol=0.02 * np.linalg.norm(expected))


def test_unloaded_it_reads_the_weight_of_the_gripper(world: World):
    mass = GRIPPER[world.config.robot.name]
    np.testing.assert_allclose(world.gripper_mass, mass, rtol=1e-12)
    np.testing.assert_allclose(world.wrench[-10:].mean(axis=0), [0, 0, -9.81 * mass, 0, 0, 0], atol=5e-3)


def test_a_bar_held_off_its_centre_reads_its_weight_and_moment(world: World):
    """What a closed gripper holds is felt as well as what hangs on it: no torque gets lost between the pads."""
    mass, offset = 0.2, 0.03
    bar = world.add_box((0.08, 0.015, 0.015), (0.55 + offset, 0.0, 0.015), 0.0, mass, friction=1.0)
    world.tare()
    move(world, (0.55, 0.0, 0.02, 0.0))
    hold(world, 4 + travel_steps(world, 1.0), opening=0.0)
    assert world.holds(bar)
    move(world, (0.55, 0.0, 0.15, 0.0), opening=0.0, stride=0.3)
    hold(world, 40, opening=0.0)
    assert world.holds(bar)
    reading = world.wrench[-25:].mean(axis=0, dtype=np.float64) - world.tare_offset
    force = np.array([0.0, 0.0, -9.81 * mass])
    torque = np.cross(world.pose(bar)[:3] - sensor_origin(world), force)
    assert np.linalg.norm(torque) > 0.01
    np.testing.assert_allclose(reading[:3], force, atol=0.02 * np.linalg.norm(force))
    np.testing.assert_allclose(reading[3:], torque, atol=0.02 * np.linalg.norm(torque))
