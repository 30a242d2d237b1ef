"""Household picking: which objects there are, how they lie, when one is picked, and an expert who does not give up."""

from itertools import pairwise

import numpy as np
import pybullet
import pytest

from collectors.simulation import World
from collectors.tasks.household_objects import (
    COUNT,
    HEIGHT,
    REACH,
    graspable,
    grasps,
    objects,
    rotation,
    split,
    surface,
)
from collectors.tasks.household_picking import FLOOR, INNER, LIFTED, SPREAD, HouseholdPicking
from collectors.tasks.household_picking_heldout import HouseholdPickingHeldout
from tests.helpers.worlds import AGAIN, begin, perform, place


def test_the_table_is_what_the_rule_gives():
    """Both ways, on every 100th object: those in the table are graspable and lie as stored, the others are not."""
    known = {lying.name: lying for lying in objects()}
    names = [f"{index:03d}" for index in range(0, COUNT, 100)]
    assert {name in known for name in names} == {True, False}
    for name in names:
        assert graspable(name) == known.get(name)


def test_every_object_has_a_different_name_and_fits():
    names = [lying.name for lying in objects()]
    assert all(a < b for a, b in pairwise(names))
    for lying in objects()[::10]:
        points = surface(lying.name)[0] @ rotation(lying.quat_xyzw).T
        assert HEIGHT[0] <= np.ptp(points[:, 2]) <= HEIGHT[1]
        assert points[:, 2].min() == pytest.approx(-lying.height, abs=0.002)
        assert np.hypot(*points[:, :2].T).max() <= REACH < INNER - SPREAD + 0.03
        assert min(g.width for g in grasps(lying.name, np.zeros(3), np.array(lying.quat_xyzw), 0.0)) <= 0.068


def test_the_split_is_by_object():
    train, test = ({lying.name for lying in split(part)} for part in ("train", "test"))
    assert not train & test
    assert train | test == {lying.name for lying in objects()}
    assert len(train) == round(0.8 * len(objects()))


def test_the_surface_is_the_collision_shape(world):
    """A ray from outside first meets the object where our points are: scale and axes are the simulator's."""
    task = begin(HouseholdPicking, world, 1)
    pose = world.pose(task.body)
    points = surface(task.scene.name)[0] @ rotation(pose[3:]).T
    farthest = points[np.argmax(np.linalg.norm(points, axis=1))]
    ray = (pose[:3] + 2.0 * farthest, pose[:3])
    body, _, fraction, *_ = pybullet.rayTest(*ray, physicsClientId=world.client)[0]
    assert body == task.body
    assert 2.0 * (1.0 - fraction) == pytest.approx(1.0, abs=0.05)


def test_scenes_cover_the_ranges_and_parts(world):
    for task in (HouseholdPicking, HouseholdPickingHeldout):
        scenes = [task.draw(np.random.default_rng(seed), world) for seed in range(400)]
        allowed = {lying.name for lying in split(task.part)}
        assert {scene.name for scene in scenes} <= allowed
        assert len({scene.name for scene in scenes}) > 0.6 * len(allowed)
        xy = np.array([scene.xy for scene in scenes]) - world.workspace[:2].mean(axis=1)
        assert 0.95 * SPREAD < np.abs(xy).max() <= SPREAD
        for name, low, high in (("mass", 0.1, 0.2), ("friction", 0.5, 0.7), ("yaw", -np.pi, np.pi)):
            values = np.array([getattr(scene, name) for scene in scenes])
            assert low <= values.min() < low + 0.05 * (high - low)
            assert high - 0.05 * (high - low) < values.max() <= high


@pytest.mark.parametrize("seed", range(4))
def test_objects_lie_at_rest_and_the_gripper_feels_nothing(world, seed):
    task = begin(HouseholdPicking, world, seed)
    before = world.pose(task.body)
    for _ in range(4):
        world.step([1.0, 0.0, 0.0, 0.0, 0.0])
    assert np.linalg.norm(world.pose(task.body)[:3] - before[:3]) < 0.002
    assert np.abs(world.wrench[-1] - world.tare_offset).max() < 0.05


def test_success_needs_the_height_and_the_grasp(world):
    """High in the air without the fingers does not count, nor does held but low."""
    task = begin(HouseholdPicking, world, 1)
    place(world, task.body, (*task.scene.xy, task.rest_height + LIFTED + 0.05))
    assert not task.success()

    task = begin(HouseholdPicking, world, 1)
    heights = []

    def watch(_):
        if world.holds(task.body):
            heights.append(world.pose(task.body)[2] - task.rest_height)

    assert perform(task, noise=0.0, disturb=watch) is not None
    assert heights
    assert max(heights) <= LIFTED < world.pose(task.body)[2] - task.rest_height


def test_the_expert_succeeds_and_its_demonstrations_differ(world):
    lengths = {perform(begin(HouseholdPicking, world, 7), seed=seed) for seed in range(4)}
    assert None not in lengths
    assert len(lengths) > 1


def test_the_expert_tries_again_after_a_slip(world):
    """The object is taken out of the closed gripper and put down elsewhere."""
    task = begin(HouseholdPicking, world, 2)
    start = world.pose(task.body)
    taken = []

    def take(step):
        if not taken and world.holds(task.body):
            x, y = 2 * world.workspace[:2].mean(axis=1) - start[:2]  # across the middle of the bin
            pybullet.resetBasePositionAndOrientation(
                task.body, (x, y, start[2]), start[3:], physicsClientId=world.client
            )
            taken.append(step)

    assert perform(task, steps=AGAIN, disturb=take) is not None
    assert taken


def test_a_used_world_gives_the_same_bytes(world):
    perform(begin(HouseholdPicking, world, 5), steps=20)
    perform(task := begin(HouseholdPicking, world, 3), steps=20)
    with World(world.config) as fresh:
        perform(begin(HouseholdPicking, fresh, 3), steps=20)
        assert fresh.wrench.tobytes() == world.wrench.tobytes()
    assert task.scene.name in {lying.name for lying in split("train")}
    assert task.state()["object"][2] > FLOOR
