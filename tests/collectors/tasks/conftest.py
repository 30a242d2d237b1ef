"""Worlds for the task tests: an ideal sensor and no cameras that cost time."""

from collections.abc import Iterator

import pytest

from collectors.robots import OWN, make
from collectors.simulation import CameraConfig, NoiseConfig, World, WorldConfig


@pytest.fixture
def world() -> Iterator[World]:
    with World(WorldConfig(noise=NoiseConfig.none(), cameras={"front": CameraConfig(height=24, width=24)})) as world:
        yield world


@pytest.fixture(params=OWN)
def robot_world(request) -> Iterator[World]:
    """A world of each robot in turn."""
    camera = CameraConfig(height=24, width=24)
    config = WorldConfig(robot=make(request.param), noise=NoiseConfig.none(), cameras={"front": camera})
    with World(config) as world:
        world.reset(seed=0)
        yield world
