import pytest
import torch

import svfl_models.planar_escnn  # noqa: F401 - before any test imports escnn itself
from tests.models.synthetic import centering_samples


@pytest.fixture(autouse=True)
def one_thread_and_seed():
    torch.set_num_threads(1)
    torch.manual_seed(0)


@pytest.fixture(scope="session")
def samples():
    return centering_samples(40, seed=0)


@pytest.fixture(scope="session")
def batch(samples):
    """Eight samples as physical inputs, images of 64 pixels."""
    return {
        "image": torch.from_numpy(samples.image[:8, :, 6:70, 6:70].copy()),
        "wrench": torch.from_numpy(samples.wrench[:8]),
    }
