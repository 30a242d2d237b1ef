import numpy as np
import pytest
import torch

from svfl_data.sampling.moments import statistics
from svfl_data.symmetry import WRENCH_PARTS, act, element
from svfl_models.networks.normalization import Normalization
from svfl_models.symmetry.actions import act_on_batch
from svfl_models.symmetry.groups import GROUPS


def fitted(samples, grippers):
    normalization = Normalization()
    normalization.fit(image=samples.image, wrench=samples.wrench, proprio=grippers["proprio"].numpy())
    return normalization


def scaled(normalization, batch):
    return {name: normalization.scaled(name, values) for name, values in batch.items()}


@pytest.fixture
def physical(batch, grippers):
    return batch | {"proprio": grippers["proprio"]}


def test_scaling_a_turned_world_is_turning_a_scaled_one(samples, grippers, physical):
    normalization = fitted(samples, grippers)
    assert not torch.equal(normalization.scaled("proprio", physical["proprio"]), physical["proprio"])
    for g in GROUPS["D4"].elements:
        turned, expected = (
            scaled(normalization, act_on_batch(g, physical)),
            act_on_batch(g, scaled(normalization, physical)),
        )
        for name in physical:
            torch.testing.assert_close(turned[name], expected[name], atol=1e-5, rtol=1e-5)


def test_a_network_fitted_on_a_turned_world_is_the_same(samples, grippers):
    first, second = fitted(samples, grippers), Normalization()
    everything = {
        "image": torch.from_numpy(samples.image),
        "wrench": torch.from_numpy(samples.wrench),
        "proprio": grippers["proprio"],
    }
    for g in GROUPS["D4"].elements:
        second.fit(**{name: values.numpy() for name, values in act_on_batch(g, everything).items()})
        for name, values in first.state_dict().items():
            torch.testing.assert_close(second.state_dict()[name], values, atol=1e-5, rtol=1e-5)


def test_the_yaw_is_left_alone(samples, grippers):
    normalization = fitted(samples, grippers)
    assert torch.equal(normalization.scaled("proprio", grippers["proprio"])[:, 4], grippers["proprio"][:, 4])


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
    normalization.fit(image=samples.image, wrench=samples.wrench)
    image = normalization.scaled("image", torch.from_numpy(samples.image))
    wrench = normalization.scaled("wrench", torch.from_numpy(samples.wrench))
    torch.testing.assert_close(image.mean(dim=(0, 2, 3)), torch.zeros(4), atol=1e-4, rtol=0)
    torch.testing.assert_close(image.std(dim=(0, 2, 3)), torch.ones(4), atol=1e-3, rtol=0)
    torch.testing.assert_close(wrench[..., :2].square().mean(), torch.tensor(1.0), atol=1e-4, rtol=0)


def test_a_constant_channel_is_not_blown_up(samples):
    normalization = Normalization()
    normalization.fit(image=np.full((3, 4, 8, 8), 0.25, np.float32), wrench=samples.wrench)
    assert normalization.scaled("image", torch.full((1, 4, 8, 8), 0.25)).abs().max() < 1e-6


def test_statistics_travel_with_the_weights(samples, grippers, physical):
    known, fresh = fitted(samples, grippers), Normalization()
    fresh.load_state_dict(known.state_dict())
    for name, values in scaled(known, physical).items():
        assert torch.equal(scaled(fresh, physical)[name], values)
