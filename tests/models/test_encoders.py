import pytest
import torch
from torch import nn

from svfl_data.symmetry import WRENCH_PARTS, dihedral
from svfl_models.baselines import PlainLayers
from svfl_models.encoders import ForceEncoder, Fusion, SelfAttention, VisionEncoder, position_encoding
from svfl_models.layers import SymmetricLayers
from svfl_models.representations import wrench_parts
from svfl_models.testing import act_on_hidden, assert_equivariant, equivariance_error

WIDTHS = (1, 2, 3, 4, 5, 4)


def force_encoder(order=4, torque="axial", window=64):
    return ForceEncoder(SymmetricLayers(order), wrench_parts(torque), window, width=4, heads=2, latent=8)


def forces(network, inputs):
    return network(inputs["wrench"])


def test_vision_features_are_equivariant(batch):
    encoder = VisionEncoder(SymmetricLayers(), WIDTHS, latent=8)
    assert_equivariant(encoder, batch, act_on_hidden(), function=lambda network, inputs: network(inputs["image"]))


@pytest.mark.parametrize("order", [4, 8])
def test_force_features_are_equivariant(batch, order):
    """For force 45 degrees are as exact as 90: there are no pixels."""
    wrench = {"wrench": batch["wrench"]}
    assert_equivariant(force_encoder(order), wrench, act_on_hidden(order), elements=dihedral(order), function=forces)


def test_a_polar_torque_breaks_exactly_the_reflections(batch):
    encoder = force_encoder(torque="polar")
    wrench = {"wrench": batch["wrench"]}
    errors = equivariance_error(lambda b: encoder(b["wrench"]), wrench, act_on_hidden())
    assert max(errors[:4]) < 1e-5
    assert min(errors[4:]) > 0.05
    with pytest.raises(AssertionError, match="not equivariant"):
        assert_equivariant(encoder, wrench, act_on_hidden(), function=forces)


class SlippedAttention(SelfAttention):
    """The published slip: a reshape that takes the channel order to be (group element, field)."""

    def forward(self, x):
        x = super().forward(x)
        return x.unflatten(-1, (8, -1)).transpose(-1, -2).flatten(-2)


def test_the_published_reshape_slip_is_caught(batch):
    encoder = force_encoder()
    wrench = {"wrench": batch["wrench"]}
    assert_equivariant(encoder, wrench, act_on_hidden(), function=forces)
    encoder.attention.__class__ = SlippedAttention
    errors = equivariance_error(lambda b: encoder(b["wrench"]), wrench, act_on_hidden())
    assert min(errors[1:]) > 0.1
    with pytest.raises(AssertionError, match="not equivariant"):
        assert_equivariant(encoder, wrench, act_on_hidden(), function=forces)


@pytest.mark.parametrize("kit", [SymmetricLayers(), PlainLayers()])
def test_every_reading_reaches_the_output(kit):
    encoder = ForceEncoder(kit, WRENCH_PARTS, window=64, width=8, heads=2, latent=6)
    wrench = torch.randn(8, 64, 6, requires_grad=True)
    encoder(wrench).square().sum().backward()
    reached = wrench.grad.abs().sum(dim=(0, 2))
    assert reached.shape == (64,)
    assert (reached > 0).all()


def test_the_order_of_the_readings_matters_to_attention(batch):
    encoder = force_encoder()
    embedded = torch.relu(encoder.embed(batch["wrench"] @ encoder.basis.T))
    mixed = encoder.attention(embedded + encoder.position)
    turned = encoder.attention(embedded.flip(1) + encoder.position).flip(1)
    assert not torch.allclose(mixed, turned, atol=1e-3)


@pytest.mark.parametrize("window", [1, 7, 128])
def test_any_window_length(window):
    wrench = {"wrench": torch.randn(2, window, 6)}
    assert_equivariant(force_encoder(window=window), wrench, act_on_hidden(), function=forces)


def test_position_codes_differ_between_readings_and_are_bounded():
    code = position_encoding(64, 8)
    assert torch.unique(code, dim=0).shape[0] == 64
    assert code.abs().max() <= 1


def test_fusion_is_equivariant():
    class Both(nn.Module):
        def __init__(self):
            super().__init__()
            self.force, self.fusion = force_encoder(), Fusion(SymmetricLayers(), 2, latent=8)

        def forward(self, batch):
            features = self.force(batch["wrench"])
            return self.fusion([features, features.square()])

    assert_equivariant(Both(), {"wrench": torch.randn(4, 64, 6)}, act_on_hidden())


def test_an_output_of_zero_proves_nothing(batch):
    with pytest.raises(ValueError, match="the output is zero"):
        equivariance_error(lambda b: torch.zeros(8, 8), {"wrench": batch["wrench"]}, act_on_hidden())
