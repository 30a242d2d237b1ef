"""An image and a wrench go from the sensor to the network as docs/architecture.md shows."""

import sys
import threading

import numpy as np
import pytest
import torch

from docs.architecture import WAYS
from svfl_data.datasets.dataset import Dataset
from svfl_data.storage.store import write_episode

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def called(tmp_path_factory):
    """All calls of the three packages' functions that a sample passes."""
    from collectors.simulation.camera import CameraConfig
    from collectors.simulation.config import WorldConfig
    from collectors.sources.centering import CenteringCollector
    from svfl_data.sampling.centering_samples import load_centering
    from svfl_models.centering.classifier import CenteringClassifier
    from svfl_models.centering.data import Crops

    found: list[str] = []

    def note(frame, event, argument):
        module = frame.f_globals.get("__name__", "")
        if event == "call" and module.startswith(("svfl_data.", "svfl_models.", "collectors.")):
            found.append(f"{module}.{frame.f_code.co_qualname}")

    world = WorldConfig(cameras={"front": CameraConfig(height=16, width=16)})
    dataset = Dataset.create_or_resume(tmp_path_factory.mktemp("way") / "d", "centering", 0, {})
    network = CenteringClassifier("vf", group="none", preset="tiny", image_size=8)
    sys.setprofile(note)
    threading.setprofile(note)
    try:
        write_episode(CenteringCollector(seed=0, world=world)(0), dataset.episode_path(0))
        samples = load_centering(dataset.path)
        network.fit(samples)
        batch = Crops(samples, ("image", "wrench"), 8)[[0]]
        with torch.no_grad():
            network(batch)
    finally:
        sys.setprofile(None)
        threading.setprofile(None)
    assert np.isfinite(batch["wrench"].numpy()).all()
    return found


@pytest.mark.parametrize("name", WAYS)
def test_calls_are_made_in_the_order_of_the_page(called, name):
    calls = iter(called)
    assert [place for place in WAYS[name] if place not in calls] == []  # each after the one before it
