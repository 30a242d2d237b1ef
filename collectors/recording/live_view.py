"""Episodes on a running viewer while they are collected, in whichever process that is."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from collectors.recording.loop import Watcher, unwatched
from collectors.recording.worker import Collector, forget
from svfl_data.schema.episode import Episode
from svfl_data.schema.robot import Observation, Robot

if TYPE_CHECKING:
    from svfl_data.viewer.live import Live


@dataclass(frozen=True)
class Watched:
    """A collector whose episodes are shown as they are recorded.

    Attributes:
        collector: Makes the episodes.
        address: HOST:PORT of the viewer.
    """

    collector: Collector
    address: str

    def __call__(self, index: int, *, keep: Callable[[Episode], None] = forget, watch: Watcher = unwatched) -> Episode:
        """Collect the episode of an index; attempts that fail are shown as well."""
        with shown(self.address, index) as live:

            def both(robot: Robot, observation: Observation, action: NDArray[np.float32] | None) -> None:
                live(robot, observation, action)
                watch(robot, observation, action)

            return self.collector(index, keep=keep, watch=both)


@contextmanager
def shown(address: str, index: int) -> Iterator[Watcher]:
    """Give what shows the episode of an index on a viewer while it is recorded, whether or not it is kept.

    Raises:
        UsageError: If nothing listens there.
    """
    live = viewer(address)
    live.name = f"episode {index}"
    try:
        yield live
    finally:
        live.finish()


@cache
def viewer(address: str) -> Live:
    """This process's connection to a viewer.

    Raises:
        UsageError: If nothing listens there.
    """
    from svfl_data.viewer.live import Live

    return Live(address)


def watched(arguments: argparse.Namespace, collector: Collector) -> Collector:
    """The collector, shown live if that is asked for.

    Raises:
        UsageError: If nothing listens at the address.
    """
    if arguments.rerun is None:
        return collector
    viewer(arguments.rerun)  # what is wrong with it is said before anything is collected
    return Watched(collector, arguments.rerun)
