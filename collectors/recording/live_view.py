"""Episodes on a running viewer while they are collected, in whichever process that is."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

from collectors.recording.loop import watching
from collectors.recording.worker import Collector
from svfl_data.schema.episode import Episode

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

    def __call__(self, index: int, *keep: object) -> Episode:
        """Collect the episode of an index; attempts that fail are shown as well."""
        with shown(self.address, index):
            return self.collector(index, *keep)


@contextmanager
def shown(address: str, index: int) -> Iterator[None]:
    """Show the episode of an index on a viewer while it is recorded in this block, whether or not it is kept.

    Raises:
        UsageError: If nothing listens there.
    """
    live = viewer(address)
    live.name = f"episode {index}"
    with watching(live):
        try:
            yield
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
