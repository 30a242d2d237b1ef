"""Robots by name: this package's, those that another package adds, and names that nobody knows."""

import json
import tomllib
from contextlib import closing
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from collectors.environment import Environment
from collectors.robots import DEFAULT, GROUP, OWN, make, robots
from collectors.simulation import PandaConfig, UR5eConfig, WorldConfig
from collectors.sources.expert import ExpertCollector
from collectors.sources.replay import from_json, replay
from svfl_data.errors import FormatError, UsageError
from tests.helpers import added_robot
from tests.helpers.collectors import SMALL

ROOT = Path(__file__).parents[3]


@pytest.fixture
def added(tmp_path, monkeypatch):
    """Name of a robot that another package adds, which declares one more that is not there."""
    return added_robot.install(tmp_path, monkeypatch)


def test_the_robots_of_this_package_are_those_it_declares():
    assert tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["entry-points"][GROUP] == OWN
    assert {name: type(make(name)) for name in OWN} == {"panda_sim": PandaConfig, "ur5e_sim": UR5eConfig}
    assert make(DEFAULT) == WorldConfig().robot


@pytest.mark.parametrize("name", OWN)
def test_a_robot_has_its_name_and_is_read_back_from_json(name):
    world = replace(SMALL, robot=replace(make(name), friction=0.7))
    assert world.robot.name == name
    assert from_json(WorldConfig, json.loads(json.dumps(asdict(world))), "config.world") == world


def test_a_package_of_ones_own_adds_a_robot(added):
    assert set(robots()) >= {added, *OWN}
    assert type(make("panda_sim")) is PandaConfig  # a name of this package means this package's robot
    episode = ExpertCollector(0, "block_picking", world=replace(SMALL, robot=make(added)))(0)
    assert episode.meta.config["world"]["robot"]["name"] == added
    assert not any(replay(episode).differences.values())
    assert any(replay(episode, make("ur5e_sim")).differences.values())


def test_a_robot_that_nobody_knows_is_named_with_those_there_are(added):
    with pytest.raises(UsageError, match=r"no robot 'abacus'; possible are .*panda_sim, .*slow_sim, ur5e_sim"):
        make("abacus")
    with pytest.raises(UsageError, match="gone_sim: slow_package:Gone cannot be loaded"):
        make("gone_sim")
    with pytest.raises(FormatError, match=r"config\.world: .*name"):
        from_json(WorldConfig, {"robot": []}, "config.world")


def test_an_environment_takes_a_robot_by_name():
    with closing(Environment("block_picking", SMALL, robot="ur5e_sim")) as env:
        assert env.world.config == replace(SMALL, robot=make("ur5e_sim"))
        observation, _ = env.reset(seed=0)
        np.testing.assert_allclose(observation["proprio"], [1.0, *SMALL.home, 0.0], atol=1e-4)
    with pytest.raises(UsageError, match="'abacus'"):
        Environment("block_picking", robot="abacus")
