"""Robot that writes a journal while it works, so that a killed process loses at most half a second of an episode."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from collectors.recording.loop import OBJECT
from collectors.recording.observed import rows
from svfl_data.recording.writer import EpisodeWriter
from svfl_data.schema.robot import Observation, Robot
from svfl_data.system.own_process import OwnProcess


class Journaled(OwnProcess):
    """Robot that writes all it observes and does into the journal of the current episode.

    Args:
        robot: Robot that does the work.
        writer: Writer of the episode's journal.
    """

    def __init__(self, robot: Robot, writer: EpisodeWriter) -> None:
        self._rig, self._writer = robot, writer
        self._readings = 0
        self._t_ns = np.zeros(1, np.int64)

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - whatever the robot has
        return getattr(self._rig, name)

    def observe(self) -> Observation:
        """Observe, and append the observation and all new readings to the journal."""
        self.check_process()
        seen = self._rig.observe()
        self._t_ns = np.array([seen.t_ns], np.int64)
        for group, columns in rows(seen).items():
            self._writer.append(group, **columns)
        t_ns, wrench = self._rig.wrench_t_ns, self._rig.wrench
        count = min(len(t_ns), len(wrench))  # the sensor of some robots adds readings between these two calls
        self._writer.append("streams/wrench", t_ns=t_ns[self._readings : count], wrench=wrench[self._readings : count])
        self._readings = count
        return seen

    def step(self, action: NDArray[np.float32]) -> None:
        """Append the action to the journal, and carry it out.

        Args:
            action: Action (opening, dx, dy, dz, dtheta), (5,), base axes, [m] and [rad].
        """
        self.check_process()
        self._writer.append("actions", action=action[None])
        self._rig.step(action)

    def state(self, values: Mapping[str, np.ndarray]) -> Mapping[str, np.ndarray]:
        """Append the true values that belong to the last observation to the journal, and return them.

        Args:
            values: True values by name.
        """
        if OBJECT in values:
            self._writer.append("streams/object", t_ns=self._t_ns, pose=values[OBJECT][None])
        others: dict[str, Any] = {name: value[None] for name, value in values.items() if name != OBJECT}
        if others:
            self._writer.append("extra/state", **others)
        return values
