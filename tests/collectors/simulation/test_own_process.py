"""A world, what looks into it and what plays in it work in the process that made them, and nowhere else."""

import copy
import os
import pickle
import re
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import pytest

from collectors.environment import Environment
from collectors.simulation import CameraConfig, World, WorldConfig
from collectors.simulation.bodies import Bodies, Box
from collectors.simulation.camera import Camera
from collectors.sources.expert import ExpertCollector
from svfl_data.errors import UsageError
from svfl_data.storage.store import episode_bytes
from tests.helpers.child import in_child

pytestmark = pytest.mark.slow

SMALL = WorldConfig(cameras={"front": CameraConfig(height=24, width=24)})
STILL = np.array([1.0, 0.0, 0.0, 0.0, 0.0], np.float32)
USES: dict[type, list[Callable[[Any], Any]]] = {
    World: [
        lambda world: world.reset(seed=0),
        lambda world: world.step(STILL),
        lambda world: world.observe(),
        lambda world: world.tare(),
        lambda world: world.add_box((0.02, 0.02, 0.02), (0.5, 0.0, 0.02), 0.0, 0.1, 0.5),
        lambda world: world.pose(0),
        lambda world: world.finger_contacts(0),
        lambda world: world.client,
        lambda world: world.close(),
    ],
    Camera: [lambda camera: camera.render()],
    Bodies: [
        lambda bodies: bodies.add([Box((0.02, 0.02, 0.02))], (0.5, 0.0, 0.02)),
        lambda bodies: bodies.add_urdf("plane.urdf", (0.0, 0.0, 0.0)),
        lambda bodies: bodies.set_dynamics(0, mass=0.1),
    ],
    Environment: [
        lambda env: env.reset(seed=0),
        lambda env: env.step(STILL),
        lambda env: env.expert(),
        lambda env: env.render(),
        lambda env: env.close(),
    ],
}


@pytest.fixture(params=USES, ids=lambda kind: kind.__name__)
def owner(request):
    if request.param is Environment:
        env = Environment("block_picking", SMALL, render_mode="rgb_array")
        env.reset(seed=0)
        yield env
        env.close()
        return
    with World(SMALL) as world:
        world.reset(seed=0)
        yield {World: world, Camera: Camera(CameraConfig(24, 24), world.client), Bodies: world.bodies}[request.param]


def test_a_fork_is_refused_every_use(owner):
    def refused() -> int:
        count = 0
        for use in USES[type(owner)]:
            try:
                use(owner)
            except UsageError as error:
                count += bool(re.search(rf"\b{os.getppid()}\b.*\b{os.getpid()}\b", str(error)))
        return count

    assert in_child(refused) == len(USES[type(owner)])


@pytest.mark.parametrize("carry", [pickle.dumps, copy.copy, copy.deepcopy])
def test_it_is_neither_pickled_nor_copied(owner, carry):
    with pytest.raises(UsageError, match="pickled nor copied"):
        carry(owner)


def test_a_fork_that_leaves_the_block_leaves_the_parents_world_alone():
    def leave() -> int:
        with world:
            return 7

    with World(SMALL) as world:
        world.reset(seed=0)
        assert in_child(leave) == 7
        world.step(STILL)
        assert world.observe().frames["front"].color.any()


def test_a_closed_world_says_so():
    world = World(SMALL)
    world.close()
    with pytest.raises(UsageError, match="closed"):
        world.reset(seed=0)


def test_a_collector_opens_a_world_of_its_own_in_child():
    collector = ExpertCollector(0, "block_picking", world=SMALL)
    here = episode_bytes(collector(0))
    assert in_child(lambda: int(episode_bytes(collector(0)) == here)) == 1
    collector.opened.close()


@pytest.mark.parametrize("context", ["fork", "spawn"])
def test_vectorised_environments_make_their_worlds_themselves(context):
    """Gymnasium's processes get functions, not environments: they play as one in this process does."""
    vector = gymnasium.vector.AsyncVectorEnv([make_one, make_one], context=context)
    try:
        seen, _ = vector.reset(seed=[3, 4])
        stepped, *_ = vector.step(np.stack([STILL, STILL]))
    finally:
        vector.close()
    for index, seed in enumerate((3, 4)):
        env = make_one()
        alone, _ = env.reset(seed=seed)
        np.testing.assert_array_equal(seen["wrench"][index], alone["wrench"])
        after, *_ = env.step(STILL)
        np.testing.assert_array_equal(stepped["image"][index], after["image"])
        env.close()


def make_one() -> gymnasium.Env:
    return Environment("block_picking", SMALL)
