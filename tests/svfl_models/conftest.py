import pytest
import torch

import svfl_models.symmetry.planar_escnn  # noqa: F401 - before any test imports escnn itself
from tests.helpers.synthetic import centering_samples, gripper_states


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


@pytest.fixture(scope="session")
def grippers():
    """Eight states of the gripper and what it might do in them."""
    proprio, action = gripper_states(8, seed=0)
    return {"proprio": torch.from_numpy(proprio), "action": torch.from_numpy(action)}
