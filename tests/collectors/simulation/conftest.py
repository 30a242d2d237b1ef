"""Worlds for the tests: an ideal sensor and a small picture unless a test says otherwise."""

from collections.abc import Iterator
from dataclasses import replace

import pytest

from collectors.robots import OWN, make
from collectors.simulation import CameraConfig, NoiseConfig, World, WorldConfig
from collectors.simulation.arms.arm import RobotConfig


@pytest.fixture
def ideal() -> WorldConfig:
    return WorldConfig(noise=NoiseConfig.none(), cameras={"front": CameraConfig(height=24, width=24)})


@pytest.fixture
def world(ideal: WorldConfig) -> Iterator[World]:
    with World(ideal) as world:
        world.reset(seed=0)
        yield world


@pytest.fixture(params=OWN)
def robot(request) -> RobotConfig:
    """Each robot in turn; what a test holds of one, it holds of all."""
    return make(request.param)


@pytest.fixture
def robot_world(ideal: WorldConfig, robot: RobotConfig) -> Iterator[World]:
    with World(replace(ideal, robot=robot)) as world:
        world.reset(seed=0)
        yield world
