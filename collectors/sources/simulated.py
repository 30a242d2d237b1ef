"""What collectors in simulation share: one world for all their episodes."""

from dataclasses import fields
from typing import Any

from collectors.simulation.config import WorldConfig
from collectors.simulation.world import World

VERSIONS = ("svfl", "pybullet", "numpy")
"""Packages that a simulated episode depends on."""


class Simulated:
    """A dataclass that opens its world when it first needs it, keeps it, and goes to other processes without it.

    Attributes:
        world: Physics, arm, sensors and cameras.
    """

    world: WorldConfig

    @property
    def opened(self) -> World:
        """The world of this process; a reset brings it back exactly, so that what was done in it does not matter."""
        kept: World | None = vars(self).get("_opened")
        if kept is None or not kept.in_own_process:
            kept = vars(self)["_opened"] = World(self.world)
        return kept

    def __getstate__(self) -> dict[str, Any]:
        return {field.name: getattr(self, field.name) for field in fields(self)}  # type: ignore[arg-type]
