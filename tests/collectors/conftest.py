"""Collectors small enough for tests of what is around them."""

import os
import signal
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from collectors.recording.worker import Worker
from collectors.simulation import CameraConfig, WorldConfig
from collectors.sources.expert import ExpertCollector
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


def contents(folder: Path) -> dict[str, bytes]:
    """Every file of a folder, with folders inside, but for the index, which whoever reads the folder may write."""
    files = [file for file in sorted(folder.rglob("*")) if file.is_file() and file.name != "index.jsonl"]
    return {str(file.relative_to(folder)): file.read_bytes() for file in files}


@pytest.fixture(scope="session")
def picked(tmp_path_factory) -> Path:
    """Three demonstrations of block picking by one worker, in this order."""
    folder = tmp_path_factory.mktemp("picked") / "block_picking"
    collector = ExpertCollector(0, "block_picking", world=SMALL)
    worker = Worker(collector, folder, "block_picking", 0, collector.config())
    worker.dataset()
    for index in range(3):
        worker.collect(index)
    collector.opened.close()
    return folder
