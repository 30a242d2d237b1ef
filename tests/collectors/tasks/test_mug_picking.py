"""Mug picking: what is drawn, where the handle is, when it is done, and an expert who does not give up."""

from pathlib import Path

import numpy as np
import pybullet_data
import pytest

from collectors.simulation import World
from collectors.tasks.mug_picking import CUP, GRASP, HANDLE, LIFTED, MASS_CENTRE, RIM, MugPicking, Scene
from tests.helpers.worlds import AGAIN, begin, hold, move, perform, place

pytestmark = pytest.mark.slow


def scene(yaw: float = 0.0, scale: float = 0.8) -> Scene:
    return Scene(xy=(0.55, 0.02), yaw=yaw, scale=scale, mass=0.3, friction=0.7)


def set_up(world: World, which: Scene) -> MugPicking:
    world.reset(seed=0)
    task = MugPicking(world, which)
    world.tare()
    return task


def risen(task: MugPicking) -> float:
    return task.world.pose(task.body)[2] - task.scene.scale * MASS_CENTRE[2]


def grasp(task: MugPicking, at, height: float, theta: float) -> None:
    """Close the gripper round a point of the mesh, the TCP at `height` [m]."""
    x, y, _ = task.in_base(at)
    move(task.world, (x, y, task.scene.scale * RIM + 0.03, theta))
    move(task.world, (x, y, height, theta), stride=0.5)
    hold(task.world, 6, opening=0.0)


def test_scenes_cover_the_ranges_inside_the_workspace(world):
    scenes = [MugPicking.draw(np.random.default_rng(seed), world) for seed in range(300)]
    ranges = (("yaw", -np.pi, np.pi), ("scale", 0.8, 1.1), ("mass", 0.2, 0.4), ("friction", 0.5, 1.0))
    for name, low, high in ranges:
        values = np.array([getattr(one, name) for one in scenes])
        assert low <= values.min() < low + 0.05 * (high - low)
        assert high - 0.05 * (high - low) < values.max() <= high
    for one in scenes:
        outermost = one.scale * HANDLE[1, 1] * np.array([-np.sin(one.yaw), np.cos(one.yaw)])
        ends = np.array([one.xy, one.xy + outermost])
        assert (ends > world.workspace[:2, 0] - 0.01).all()
        assert (ends < world.workspace[:2, 1] + 0.01).all()


def test_the_handle_is_where_the_collision_mesh_has_it():
    """Of the six convex parts one is the cup; the box round the other five begins inside its wall."""
    parts: list[list[list[float]]] = []
    for line in (Path(pybullet_data.getDataPath()) / "objects" / "mug_col.obj").read_text().splitlines():
        if line.startswith("o "):
            parts.append([])
        elif line.startswith("v "):
            parts[-1].append([float(word) for word in line.split()[1:]])
    assert len(parts) == 6
    cup, handle = np.array(parts[0]), np.concatenate(parts[1:])
    assert np.abs(handle.min(axis=0) - [HANDLE[0, 0], 0.0385, HANDLE[2, 0]]).max() < 1e-4
    assert HANDLE[1, 0] > CUP > 0.0385
    assert np.abs(handle.max(axis=0) - HANDLE[:, 1]).max() < 1e-4
    assert np.linalg.norm(cup[:, :2], axis=1).max() == pytest.approx(CUP, abs=1e-5)
    assert cup[:, 2].max() == pytest.approx(RIM, abs=1e-5)


@pytest.mark.parametrize("yaw", [0.0, 2.0])
def test_the_mug_rests_where_it_was_drawn(world, yaw):
    """It neither drops nor slides nor touches the gripper; its frame is the mesh's."""
    task = set_up(world, scene(yaw))
    hold(world, 4)
    assert np.abs(task.in_base((0.0, 0.0, 0.0)) - [*task.scene.xy, 0.0]).max() < 0.001
    assert world.yaw(task.body) == pytest.approx(yaw, abs=0.01)
    x, y, _ = task.in_base((0.0, 1.0, 0.0)) - task.in_base((0.0, 0.0, 0.0))
    assert np.arctan2(-x, y) == pytest.approx(yaw, abs=0.01)
    assert np.abs(world.wrench[-50:] - world.tare_offset).max() < 0.05


def test_success_needs_the_height_and_the_grasp(world):
    """Held by the handle but low does not count, nor does high in the air without the fingers."""
    task = set_up(world, scene())
    place(world, task.body, (*task.scene.xy, LIFTED + 0.1))
    assert risen(task) > LIFTED
    assert not task.success()

    task = set_up(world, scene())
    grasp(task, GRASP, task.scene.scale * GRASP[2], np.pi / 2)
    assert task.by_handle()
    heights = []
    while not task.success():
        heights.append(risen(task))
        world.step([0.0, 0.0, 0.0, 0.004, 0.0])
        assert len(heights) < 60
    assert LIFTED - 0.01 < max(heights) <= LIFTED


def test_a_grasp_of_the_cup_does_not_count(world):
    """Fingers on both sides of a small cup lift it as high, in vain."""
    task = set_up(world, scene())
    grasp(task, (0.0, 0.0, 0.0), 0.055, np.pi / 2)
    move(world, (*world.target[:2], 0.055 + LIFTED + 0.05, np.pi / 2), opening=0.0, stride=0.4)
    assert world.holds(task.body)
    assert risen(task) > LIFTED + 0.02
    assert not task.success()


def test_the_sensor_feels_the_drawn_mass(world):
    task = begin(MugPicking, world, 4)
    assert perform(task, noise=0.0) is not None
    hold(world, 8, opening=0.0)
    fz = (world.wrench[-25:] - world.tare_offset)[:, 2].mean()
    assert fz == pytest.approx(-9.81 * task.scene.mass, rel=0.03)


def test_the_expert_succeeds_any_way_round_and_its_demonstrations_differ(world):
    lengths = set()
    for yaw in np.arange(-3.0, 3.1, 1.5):
        task = set_up(world, scene(float(yaw), scale=1.1 if yaw > 0 else 0.8))
        lengths |= {perform(task, seed=3), perform(set_up(world, task.scene), seed=4)}
    assert None not in lengths
    assert len(lengths) > 1


def test_the_expert_tries_again_after_a_slip(world):
    """The mug is taken out of the closed gripper and put down elsewhere, turned."""
    task = begin(MugPicking, world, 2)
    taken = []

    def take(step):
        if not taken and world.holds(task.body):
            place(world, task.body, (0.5, 0.02, task.scene.scale * MASS_CENTRE[2]), yaw=-1.4)
            taken.append(step)

    assert perform(task, steps=AGAIN, disturb=take) is not None
    assert taken


def test_the_same_seed_gives_the_same_bytes_in_a_used_world(world):
    perform(begin(MugPicking, world, 5))
    task = begin(MugPicking, world, 6)
    perform(task)
    with World(world.config) as fresh:
        again = begin(MugPicking, fresh, 6)
        perform(again)
        assert again.drawn() == task.drawn()
        assert fresh.wrench.tobytes() == world.wrench.tobytes()
