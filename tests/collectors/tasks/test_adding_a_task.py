"""A new task needs its file and one line: the task that the documentation adds works everywhere."""

import re
import sys
import types
from pathlib import Path

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from collectors.environment import Environment
from collectors.simulation import CameraConfig, NoiseConfig, World, WorldConfig
from collectors.sources.expert import ExpertCollector
from collectors.tasks import TASKS, task_class
from collectors.tasks.gripper import Gripper

PAGE = Path(__file__).parents[3] / "docs" / "adding-a-task.md"


@pytest.fixture
def documented(monkeypatch):
    """The page's file and line, as if they had been added."""
    page = PAGE.read_text()
    code = re.search(r"```python\n(.*?)```", page, re.S)[1]
    name, class_name = re.search(r'^    "(\w+)": "(\w+)",$', page, re.M).groups()
    module = types.ModuleType(f"collectors.tasks.{name}")
    monkeypatch.setitem(sys.modules, module.__name__, module)
    exec(compile(code, str(PAGE), "exec"), module.__dict__)
    monkeypatch.setitem(TASKS, name, class_name)
    return name


@pytest.mark.filterwarnings("ignore:.*Box observation space:UserWarning")  # a wrench has no bounds
def test_the_documented_task_works_everywhere(documented):
    world = WorldConfig(cameras={"front": CameraConfig(height=24, width=24)})
    assert task_class(documented).__name__ == "ButtonPressing"
    env = Environment(documented, world)
    check_env(env, skip_render_check=True)
    env.close()
    episode = ExpertCollector(seed=0, task=documented, world=world)(3)
    assert episode.meta.success
    assert episode.meta.config["drawn"].keys() == {"xy"}
    assert episode.tared_wrench[-50:, 2].mean() > 15.0


def test_an_impact_is_no_success(documented):
    """A threshold of force must hold for a while: one reading above it does not do the task."""
    with World(WorldConfig(noise=NoiseConfig.none(), cameras={"front": CameraConfig(24, 24)})) as world:
        task = task_class(documented).begin(world, np.random.SeedSequence([3]))
        gripper = Gripper(world, np.random.default_rng(0), noise=0.0)
        world.finger_contacts = lambda body: (True, True)  # what is felt alone decides
        for action in task.expert(gripper):
            before = len(world.wrench)
            world.step(action)
            felt = world.wrench[before:, 2] - world.tare_offset[2]
            lasting = world.wrench[-50:, 2].mean() - world.tare_offset[2] > 15.0
            assert task.success() == lasting
            if felt.max() > 15.0 and not lasting:
                return
    pytest.fail("no impact came before the press")
