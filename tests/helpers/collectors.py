"""Collectors small enough for tests of what is around them."""

import os
import signal
from dataclasses import dataclass, replace
from pathlib import Path

from collectors.simulation import CameraConfig, WorldConfig
from svfl_data.errors import CollectError
from svfl_data.schema.episode import Episode
from tests.helpers.builders import make_episode

SMALL = WorldConfig(cameras={"front": CameraConfig(height=16, width=16)})


@dataclass(frozen=True)
class Made:
    """Makes episodes of no robot at once; may kill its process, or fail, at an index."""

    dies_at: int | None = None
    dies_once: Path | None = None
    fails_at: int | None = None

    def __call__(self, index: int, **_) -> Episode:
        if index == self.dies_at and not (self.dies_once and self.dies_once.exists()):
            if self.dies_once:
                self.dies_once.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        if index == self.fails_at:
            raise CollectError(f"episode {index} cannot be made")
        episode = make_episode(index=index)
        return replace(episode, meta=replace(episode.meta, config={"rejected": []}))
