"""What every registered task must hold."""

import json
import subprocess
import sys

import numpy as np
import pybullet
import pytest

from collectors.recording.loop import OBJECT
from collectors.simulation import World
from collectors.tasks import PAPER, TASKS, task_class
from collectors.tasks.gripper import Gripper
from collectors.tasks.task import Task
from tests.helpers.worlds import begin, perform

pytestmark = pytest.mark.slow


@pytest.fixture(params=TASKS)
def task(request, robot_world) -> Task:
    return begin(task_class(request.param), robot_world, 11)


def held_mass(task: Task) -> float:
    """Mass of what is in the gripper from the start, [kg]."""
    if not task.world.holds(task.body):
        return 0.0
    return pybullet.getDynamicsInfo(task.body, -1, physicsClientId=task.world.client)[0]


def test_there_are_the_papers_nine():
    assert len(PAPER) == 9


def test_at_home_the_wrist_reads_the_weight_and_tared_nothing(task):
    mass = task.world.gripper_mass + held_mass(task)
    np.testing.assert_allclose(task.world.wrench[-10:, :3].mean(axis=0), [0, 0, -9.81 * mass], atol=0.02 * 9.81 * mass)
    tared = task.world.wrench[-25:] - task.world.tare_offset
    assert np.abs(tared[:, :3]).max() < 0.1
    assert np.abs(tared[:, 3:]).max() < 0.01


@pytest.mark.parametrize("direction", [(0, 0, 1), (1, 0, 0), (0, 1, 0)], ids="zxy")
def test_setting_the_gripper_in_motion_takes_its_momentum(task, direction):
    """The integral of the tared force over time is minus mass times velocity: F = m g - m a, with m g tared away."""
    world = task.world
    mass, opening = task.world.gripper_mass + held_mass(task), 0.0 if held_mass(task) else 1.0
    count = len(world.wrench)
    for _ in range(2):
        world.step([opening, *(0.02 * np.array(direction)), 0.0])
    impulse = (world.wrench[count:, :3] - world.tare_offset[:3]).sum(axis=0, dtype=np.float64) * 0.002
    momentum = mass * np.array(world._arm.gripper_velocity)
    assert np.linalg.norm(momentum) > 0.2
    np.testing.assert_allclose(impulse, -momentum, atol=0.05 * np.linalg.norm(momentum))


def test_the_expert_asks_for_what_an_action_can_be(task):
    """However noisy; what is recorded is then what is carried out."""
    limit = np.array([1.0, *task.world.action_bound]) * (1 + 1e-6)
    moves = task.expert(Gripper(task.world, np.random.default_rng(0), noise=2.0))
    for action, _ in zip(moves, range(25), strict=False):
        assert (np.abs(action) <= limit).all()
        assert action[0] >= 0
        task.world.step(action)


def test_the_expert_achieves_it_with_either_robot(task):
    """In one of three scenes at least: how often it does is measured (docs/tasks.md, docs/simulation.md)."""
    kind, world = type(task), task.world
    assert any(perform(begin(kind, world, seed), seed=seed) is not None for seed in (11, 12, 13))


def test_a_used_world_gives_the_bytes_of_a_fresh_one(task):
    kind, used = type(task), task.world
    perform(task, steps=12)
    again, steps = begin(kind, used, 12), []
    with World(used.config) as fresh:
        other = begin(kind, fresh, 12)
        steps = [perform(one, noise=1.0, seed=1, steps=25) for one in (again, other)]
        assert steps[0] == steps[1]
        assert used.wrench.tobytes() == fresh.wrench.tobytes()
        for name, value in again.state().items():
            np.testing.assert_array_equal(value, other.state()[name])


def test_a_busy_machine_changes_nothing():
    """Nothing looks at the clock: with three busy processes beside it an episode comes out the same to the bit."""
    code = "while True: pass"

    def episode() -> bytes:
        with World() as world:
            perform(begin(task_class("block_pushing"), world, 5))
            return world.wrench.tobytes()

    quiet = episode()
    busy = [subprocess.Popen([sys.executable, "-c", code]) for _ in range(3)]
    try:
        assert episode() == quiet
    finally:
        for process in busy:
            process.kill()
            process.wait()


def test_the_scene_is_json_and_the_state_has_the_object(task):
    assert json.loads(json.dumps(task.drawn())) == json.loads(json.dumps(task.drawn()))
    assert task.drawn()
    pose = task.state()[OBJECT]
    assert pose.shape == (7,)
    assert abs(np.linalg.norm(pose[3:]) - 1.0) < 1e-6
    assert not task.success()
