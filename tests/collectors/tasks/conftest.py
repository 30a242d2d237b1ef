"""Worlds for the task tests: an ideal sensor and no cameras that cost time."""

from collections.abc import Iterator

import pytest

from collectors.simulation import CameraConfig, NoiseConfig, World, WorldConfig


@pytest.fixture
def world() -> Iterator[World]:
    with World(WorldConfig(noise=NoiseConfig.none(), cameras={"front": CameraConfig(height=24, width=24)})) as world:
        yield world
