"""Display of episodes on a running viewer while any process collects them."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from collectors.recording.loop import unwatched
from collectors.recording.worker import Collector, forget
from svfl_data.schema.episode import Episode
from svfl_data.schema.robot import Observation, Readings, Robot, Watcher

if TYPE_CHECKING:
    from svfl_data.viewer.live import Live


@dataclass(frozen=True)
class Watched:
    """Collector whose episodes are shown on a viewer while they are recorded.

    Attributes:
        collector: Collector that makes the episodes.
        address: Address of the viewer, HOST:PORT.
    """

    collector: Collector
    address: str

    def __call__(self, index: int, *, keep: Callable[[Episode], None] = forget, watch: Watcher = unwatched) -> Episode:
        """Collect the episode of an index, and show it, including attempts that fail.

        Args:
            index: Index of the episode in the dataset.
            keep: Function that the collector calls with every failed attempt.
            watch: Further function that is called with every observation and action.

        Raises:
            UsageError: If nothing listens at the viewer's address.
        """
        with shown(self.address, index) as live:

            def both(
                robot: Robot, observation: Observation, action: NDArray[np.float32] | None, readings: Readings
            ) -> None:
                live(robot, observation, action, readings)
                watch(robot, observation, action, readings)

            return self.collector(index, keep=keep, watch=both)


@contextmanager
def shown(address: str, index: int) -> Iterator[Watcher]:
    """Open a viewer for the episode of an index: what is yielded shows the episode while it is recorded.

    Args:
        address: Address of the viewer, HOST:PORT.
        index: Index of the episode in the dataset.

    Raises:
        UsageError: If nothing listens at the address.
    """
    live = viewer(address)
    live.name = f"episode {index}"
    yield live


@cache
def viewer(address: str) -> Live:
    """Return this process's connection to a viewer, which the first call for an address opens.

    Args:
        address: Address of the viewer, HOST:PORT.

    Raises:
        UsageError: If nothing listens at the address.
    """
    from svfl_data.viewer.live import Live

    return Live(address)


def watched(arguments: argparse.Namespace, collector: Collector) -> Collector:
    """Return a collector whose episodes are shown live if that was asked for, and the same collector otherwise.

    Args:
        arguments: Command-line arguments, of which ``rerun`` is the address of a viewer, HOST:PORT, or None.
        collector: Collector that makes the episodes.

    Raises:
        UsageError: If nothing listens at the address.
    """
    if arguments.rerun is None:
        return collector
    viewer(arguments.rerun)  # an error in the address is reported before anything is collected
    return Watched(collector, arguments.rerun)
