"""Base of the collectors in simulation: one world for all episodes of a collector."""

from dataclasses import fields
from typing import Any

from collectors.simulation.config import WorldConfig
from collectors.simulation.world import World

VERSIONS = ("svfl", "pybullet", "numpy")
"""Packages whose versions a simulated episode depends on."""


class Simulated:
    """Base of a dataclass that opens a world at first use, keeps the world open, and is pickled without it.

    Attributes:
        world: Configuration of the world: physics, arm, sensors and cameras.
    """

    world: WorldConfig

    @property
    def opened(self) -> World:
        """Open world of this process. A reset restores it exactly, so that its earlier use does not matter."""
        kept: World | None = vars(self).get("_opened")
        if kept is None or not kept.in_own_process:
            kept = vars(self)["_opened"] = World(self.world)
        return kept

    def close(self) -> None:
        """Close the world if this process has opened one."""
        kept: World | None = vars(self).pop("_opened", None)
        if kept is not None and kept.in_own_process:
            kept.close()

    def __getstate__(self) -> dict[str, Any]:
        return {field.name: getattr(self, field.name) for field in fields(self)}  # type: ignore[arg-type]
