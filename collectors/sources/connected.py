"""Base of what runs on a robot that is not simulated: one connection for all episodes."""

import os
from dataclasses import fields
from typing import Any

from collectors import robots
from svfl_data.schema.robot import Robot

VERSIONS = ("svfl", "numpy")
"""Packages whose versions an episode depends on."""


class Connected:
    """Base of a dataclass that connects to a robot at first use, and is pickled without the connection.

    Attributes:
        robot: Name of the robot (`collectors.robots`).
    """

    robot: str

    @property
    def opened(self) -> Robot:
        """The robot, connected by this process."""
        kept: tuple[int, Robot] | None = vars(self).get("_opened")
        if kept is None or kept[0] != os.getpid():
            kept = vars(self)["_opened"] = os.getpid(), robots.connected(self.robot)
        return kept[1]

    def close(self) -> None:
        """Stop and disconnect the robot if this process has connected it."""
        kept: tuple[int, Robot] | None = vars(self).pop("_opened", None)
        if kept is not None and kept[0] == os.getpid():
            kept[1].stop()
            kept[1].close()

    def __getstate__(self) -> dict[str, Any]:
        return {field.name: getattr(self, field.name) for field in fields(self)}  # type: ignore[arg-type]
