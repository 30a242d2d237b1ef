"""Demonstrations that several tests of the collectors read."""

from pathlib import Path

import pytest

from collectors.recording.worker import Worker
from collectors.sources.expert import ExpertCollector
from tests.helpers.collectors import SMALL


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
