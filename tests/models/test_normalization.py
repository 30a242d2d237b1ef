import numpy as np
import torch

from svfl_data.statistics import statistics
from svfl_data.symmetry import WRENCH_PARTS, act, element
from svfl_models.normalization import Normalization


def test_vectors_share_a_scale_and_keep_their_zero():
    wrench = np.random.default_rng(0).normal([5, 0, 20, 1, 0, 0.3], [1, 3, 2, 0.1, 0.2, 0.05], (1000, 6))
    mean, scale = statistics(wrench, WRENCH_PARTS)
    assert mean[[0, 1, 3, 4, 5]].tolist() == [0] * 5
    assert abs(mean[2] - 20) < 0.3
    assert scale[0] == scale[1]
    assert scale[3] == scale[4]
    np.testing.assert_allclose(scale[0], np.sqrt(np.mean(wrench[:, :2] ** 2)))
    assert abs(scale[2] - 2) < 0.2


def test_statistics_do_not_change_when_the_world_turns():
    wrench = np.random.default_rng(0).normal(size=(100, 64, 6)) + 1
    turned = act(element(90, flip=True), wrench, WRENCH_PARTS)
    np.testing.assert_allclose(statistics(wrench, WRENCH_PARTS), statistics(turned, WRENCH_PARTS))


def test_normalised_training_inputs_have_unit_scale(samples):
    normalization = Normalization()
    normalization.fit(samples.image, samples.wrench)
    image = normalization.image(torch.from_numpy(samples.image))
    wrench = normalization.wrench(torch.from_numpy(samples.wrench))
    torch.testing.assert_close(image.mean(dim=(0, 2, 3)), torch.zeros(4), atol=1e-4, rtol=0)
    torch.testing.assert_close(image.std(dim=(0, 2, 3)), torch.ones(4), atol=1e-3, rtol=0)
    torch.testing.assert_close(wrench[..., :2].square().mean(), torch.tensor(1.0), atol=1e-4, rtol=0)


def test_a_constant_channel_is_not_blown_up(samples):
    normalization = Normalization()
    normalization.fit(np.full((3, 4, 8, 8), 0.25, np.float32), samples.wrench)
    assert normalization.image(torch.full((1, 4, 8, 8), 0.25)).abs().max() < 1e-6


def test_statistics_travel_with_the_weights(samples):
    fitted, fresh = Normalization(), Normalization()
    fitted.fit(samples.image, samples.wrench)
    fresh.load_state_dict(fitted.state_dict())
    wrench = torch.from_numpy(samples.wrench)
    torch.testing.assert_close(fresh.wrench(wrench), fitted.wrench(wrench))
