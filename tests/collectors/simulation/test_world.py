import dataclasses
import hashlib
import json
import subprocess
import sys

import numpy as np
import pybullet
import pytest

from collectors.robots import OWN, make
from collectors.simulation import CameraConfig, World, WorldConfig
from collectors.simulation.arms.servo import rotation_error
from collectors.tasks.gripper import travel_steps
from svfl_data.errors import UsageError
from tests.helpers.worlds import hold, move

SMALL = WorldConfig(cameras={"front": CameraConfig(height=24, width=24)})  # with the default noise


def small(robot: str) -> WorldConfig:
    return dataclasses.replace(SMALL, robot=make(robot))


def act(world: World, tick: int) -> None:
    """A busy episode: a block is pushed into, gripped and dragged."""
    rng = np.random.default_rng([7, tick])
    world.step([tick % 7 < 4, *rng.uniform(-0.02, 0.02, 2), -0.015 if tick < 12 else 0.01, rng.uniform(-0.1, 0.1)])


def begin(world: World, seed: int) -> None:
    world.reset(seed)
    world.add_box((0.025, 0.025, 0.025), (0.56, 0.01, 0.025), 0.3, 0.1, 0.5)
    world.tare()


def digest(world: World) -> str:
    seen = world.observe()
    frame = seen.frames["front"]
    arrays = (world.wrench_t_ns, world.wrench, world.tare_offset, frame.color, frame.depth, seen.proprio, seen.joints)
    return hashlib.sha256(b"".join(np.ascontiguousarray(array).tobytes() for array in arrays)).hexdigest()


def episode(seed: int, robot: str = "panda_sim") -> str:
    with World(small(robot)) as world:
        begin(world, seed)
        for tick in range(20):
            act(world, tick)
        return digest(world)


@pytest.mark.parametrize("robot", OWN)
def test_the_seed_decides_every_byte(robot):
    assert episode(3, robot) == episode(3, robot)
    assert episode(3, robot) != episode(4, robot)


@pytest.mark.slow
@pytest.mark.parametrize("robot", OWN)
def test_another_process_gives_the_same_bytes(robot):
    code = f"from tests.collectors.simulation.test_world import episode; print(episode(3, {robot!r}))"
    other = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert other.stdout.split()[-1] == episode(3, robot)


def test_worlds_do_not_disturb_each_other():
    with World(SMALL) as a, World(SMALL) as b:
        begin(a, 3)
        begin(b, 4)
        for tick in range(20):
            act(a, tick)
            act(b, tick)
            b.observe()
        interleaved = digest(a), digest(b)
    assert interleaved == (episode(3), episode(4))


@pytest.mark.parametrize("robot", OWN)
def test_nothing_survives_a_reset(robot):
    with World(small(robot)) as world:
        begin(world, 9)
        hold(world, 5, opening=0.0)
        begin(world, 3)
        for tick in range(20):
            act(world, tick)
        assert digest(world) == episode(3, robot)


def test_a_renewed_world_is_the_same_world(monkeypatch):
    """Now and then a reset starts from nothing, so that memory stays bounded; nobody notices."""
    monkeypatch.setattr("collectors.simulation.world.RENEWED", 2)
    digests, clients = [], []
    with World(SMALL) as world:
        for _ in range(5):
            begin(world, 3)
            for tick in range(20):
                act(world, tick)
            digests.append(digest(world))
            clients.append(pybullet.isConnected(world.client))
    assert set(digests) == {episode(3)}
    assert all(clients)


def test_the_stream_keeps_every_reading(world: World):
    settled = len(world.wrench)
    assert settled >= 64  # a whole window before the first action
    for tick in range(3):
        act(world, tick)
        assert world.observe().t_ns == world.wrench_t_ns[-1]
    assert len(world.wrench) == settled + 3 * 25
    assert world.wrench.dtype == np.float32
    assert world.wrench_t_ns.dtype == np.int64
    np.testing.assert_array_equal(world.wrench_t_ns, 2_000_000 * np.arange(1, len(world.wrench) + 1))


def test_tare_takes_the_last_readings_and_leaves_the_stream_raw():
    with World(SMALL) as world:
        world.reset(seed=5)
        raw = world.wrench
        world.tare()
        np.testing.assert_allclose(world.tare_offset, raw[-50:].mean(axis=0), rtol=1e-5)
        np.testing.assert_array_equal(world.wrench, raw)


def test_home_is_home(robot_world: World):
    world = robot_world
    seen = world.observe()
    np.testing.assert_allclose(seen.proprio, [1.0, *world.config.home, 0.0], atol=1e-4)
    np.testing.assert_allclose(world.tcp, [*world.config.home, 1.0, 0.0, 0.0, 0.0], atol=1e-4)
    assert seen.proprio.dtype == seen.joints.dtype == np.float32


@pytest.mark.parametrize("x", [0.35, 0.55, 0.75])
@pytest.mark.parametrize("y", [-0.2, 0.0, 0.2])
def test_free_space_tracking_at_full_speed(robot_world: World, x: float, y: float):
    """Every step ends within 2 mm and 1 degree of the reference, at rest or not, all over the workspace."""
    world = robot_world
    position, angle = [], []
    goals = [(x, y, z, theta) for z in (0.02, 0.25) for theta in (-np.pi / 2, 0.0, np.pi / 2)]
    for goal in goals:
        while np.abs(goal - world.target).max() > 1e-6:
            world.step([1.0, *(goal - world.target)])
            position.append(np.linalg.norm(world.tcp[:3] - world.reference[:3]))
            angle.append(np.linalg.norm(rotation_error(world.reference[3], tuple(world.tcp[3:]))))
    assert max(position) < 2e-3
    assert np.degrees(max(angle)) < 1.0
    hold(world, 8)
    np.testing.assert_allclose(world.reference, world.target, atol=1e-9)
    assert np.linalg.norm(world.tcp[:3] - world.target[:3]) < 1e-4


def full_steps() -> dict[str, list[tuple[float, ...]]]:
    """Actions in units of the bound: every way to move along an axis, all axes together, and at random."""
    rng = np.random.default_rng(0)
    ways = {name: np.eye(4)[axis] for axis, name in enumerate(("x", "y", "z", "theta"))} | {"all": np.ones(4)}
    made = {}
    for name, way in ways.items():
        made[f"{name}, turning back"] = [way] * 3 + [-way] * 6 + [way] * 6 + [0 * way] * 2
        made[f"{name}, to and fro"] = [way, -way] * 8
        made[f"{name}, two by two"] = [way, way, -way, -way] * 4
    made["random corners"] = list(rng.choice([-1.0, 0.0, 1.0], (60, 4)))
    made["random"] = list(rng.uniform(-1, 1, (60, 4)))
    return made


@pytest.mark.parametrize("moves", full_steps().values(), ids=full_steps())
def test_a_free_gripper_feels_less_than_five_newtons(moves, robot):
    """Whatever is commanded, with the sensor's noise; and the gripper arrives."""
    with World(dataclasses.replace(SMALL, robot=robot, workspace=((0.35, 0.75), (-0.2, 0.2), (0.05, 0.25)))) as world:
        world.reset(seed=0)
        world.tare()
        settled = len(world.wrench)
        for move in moves:
            world.step([1.0, *(move * world.action_bound)])
        hold(world, 8)
        felt = np.abs(world.wrench[settled:] - world.tare_offset)
        assert felt[:, :3].max() < 5.0
        assert felt[:, 3:].max() < 0.25
        np.testing.assert_allclose(world.tcp[:3], world.target[:3], atol=1e-4)


def test_a_free_gripper_carries_out_every_action(robot_world: World):
    """However far it is behind, turning back and all: nothing of the sum is lost."""
    world = robot_world
    rng, start, total = np.random.default_rng(5), world.target, np.zeros(4)
    for way in [np.array([1.0, -1.0, -1.0, 1.0])] * 4 + list(rng.choice([-1.0, 1.0], (40, 4))):
        move = world.within(world.target + way * world.action_bound) - world.target
        total += move
        world.step([1.0, *move])
        np.testing.assert_allclose(world.target, start + total, atol=1e-9)


def test_theta_is_the_yaw_of_the_fingers(robot_world: World):
    world = robot_world
    move(world, (0.55, 0.0, 0.2, 0.6))
    hold(world, 4)
    left, right = (
        np.array(pybullet.getLinkState(world.robot, link, physicsClientId=world.client)[4])
        for link in world.finger_links
    )
    along = (right - left) / np.linalg.norm(right - left)  # at theta = 0 the left finger is at base -y
    np.testing.assert_allclose(along, [-np.sin(0.6), np.cos(0.6), 0.0], atol=2e-3)
    assert abs(world.observe().proprio[4] - 0.6) < 2e-3


def test_actions_are_clipped_to_their_bounds_and_to_the_workspace(world: World):
    start = world.target
    world.step([1.0, 1.0, -1.0, 1.0, 9.0])
    np.testing.assert_allclose(world.target - start, [0.025, -0.025, 0.025, np.pi / 16])
    for _ in range(20):
        world.step([2.0, 1.0, 1.0, 1.0, 1.0])
    np.testing.assert_allclose(world.target, [0.75, 0.2, 0.25, np.pi / 2])
    hold(world, 8)
    np.testing.assert_allclose(world.tcp[:3], [0.75, 0.2, 0.25], atol=1e-3)


@pytest.mark.parametrize("action", [[0.0] * 4, [0.0] * 6, [1.0, np.nan, 0.0, 0.0, 0.0], 3.0])
def test_an_action_must_be_five_finite_numbers(world: World, action):
    with pytest.raises(UsageError, match="5 finite numbers"):
        world.step(action)


def test_a_seed_must_not_be_negative(world: World):
    with pytest.raises(UsageError, match="seed"):
        world.reset(seed=-1)


def test_the_gripper_opens_and_closes(robot_world: World):
    world = robot_world
    travel = travel_steps(world, 1.0)
    hold(world, travel + 4, opening=0.0)
    assert abs(world.observe().proprio[0]) < 0.01
    hold(world, travel // 2 - 1, opening=1.0)
    assert 0.1 < world.observe().proprio[0] < 0.9
    hold(world, travel + 4, opening=0.5)
    assert abs(world.observe().proprio[0] - 0.5) < 0.01


def test_the_configuration_is_json(ideal: WorldConfig):
    assert json.loads(json.dumps(dataclasses.asdict(ideal)))["admittance"]["stiffness"] == 2500.0


def test_closing_twice_is_harmless_and_frees_the_client():
    world = World(SMALL)
    client = world.client
    world.close()
    world.close()
    assert not pybullet.isConnected(client)
