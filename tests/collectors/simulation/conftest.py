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


def hold(world: World, ticks: int, opening: float = 1.0) -> None:
    """Rest for a while."""
    for _ in range(ticks):
        world.step([opening, 0.0, 0.0, 0.0, 0.0])


def move(world: World, goal: tuple[float, float, float, float], opening: float = 1.0, stride: float = 1.0) -> None:
    """Command the TCP from where it is commanded to be (x, y, z, theta) in steps of at most `stride` of the bound."""
    bounds = [world.config.max_move * stride] * 3 + [world.config.max_turn * stride]
    ticks = max(1, *(int(abs(g - t) / b + 0.999999) for g, t, b in zip(goal, world.target, bounds, strict=True)))
    step = [(g - t) / ticks for g, t in zip(goal, world.target, strict=True)]
    for _ in range(ticks):
        world.step([opening, *step])
