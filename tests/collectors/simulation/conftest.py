"""Worlds for the tests: an ideal sensor and a small picture unless a test says otherwise."""

from collections.abc import Iterator

import pytest

from collectors.simulation import CameraConfig, NoiseConfig, World, WorldConfig


@pytest.fixture
def ideal() -> WorldConfig:
    return WorldConfig(noise=NoiseConfig.none(), cameras={"front": CameraConfig(height=24, width=24)})


@pytest.fixture
def world(ideal: WorldConfig) -> Iterator[World]:
    with World(ideal) as world:
        world.reset(seed=0)
        yield world
