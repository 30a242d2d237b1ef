import pytest
import torch
from torch import nn

from svfl_data.symmetry import PROPRIO_PARTS, WRENCH_PARTS, element
from svfl_models.networks.encoders import (
    ForceEncoder,
    Fusion,
    SelfAttention,
    VectorEncoder,
    VisionEncoder,
    position_encoding,
)
from svfl_models.networks.inputs import IMAGE_SIZES
from svfl_models.networks.layer_factory import layer_factory
from svfl_models.symmetry.actions import act_on_batch, act_on_feature_map, act_on_hidden, act_on_image
from svfl_models.symmetry.groups import GROUPS
from svfl_models.symmetry.representations import stored, wrench_parts
from svfl_models.symmetry.testing import assert_equivariant, equivariance_error
from tests.helpers.lifetime import TRIED, assert_equivariant_for_life, named, part_of

D4 = GROUPS["D4"]
every_group = pytest.mark.parametrize("group", TRIED, ids=named)
network_and_baseline = pytest.mark.parametrize("group", [D4, GROUPS["none"]], ids=named)


def vision_encoder(group=D4, size=64):
    return VisionEncoder(layer_factory(group), widths=(2, 2, 3, 4, 4, 4), latent=4, size=size)


def force_encoder(group=D4, torque="axial", window=8):
    return ForceEncoder(layer_factory(group), wrench_parts(torque), window, width=4, heads=2, latent=3)


def proprio_encoder(group=D4):
    return VectorEncoder(layer_factory(group), widths=(2, 3, 4), latent=3)


def wrenches(window=8, count=4):
    return {"wrench": torch.randn(count, window, 6)}


def map_after(index):
    """The maps that a vision encoder makes in one of its convolutions, before any pooling of it."""

    def compute(network, batch):
        seen = []
        hook = network.convolutions[index].register_forward_hook(lambda module, inputs, output: seen.append(output))
        network(batch["image"])
        hook.remove()
        return seen[0]

    return compute


@every_group
@pytest.mark.parametrize("index", [0, 3, 5])
def test_maps_of_the_vision_encoder_are_equivariant_before_pooling(group, index):
    image = {"image": torch.randn(2, 4, 16, 16)}
    assert_equivariant(vision_encoder(group, 16), image, group, act_on_feature_map(group), function=map_after(index))


@pytest.mark.slow
@every_group
def test_vision_features_are_equivariant_for_life(group):
    image = {"image": torch.randn(2, 4, 8, 8)}
    assert_equivariant_for_life(lambda: vision_encoder(group, 8), image, group, act_on_hidden(group), part_of("image"))


@pytest.mark.parametrize("size", IMAGE_SIZES)
def test_vision_features_are_equivariant_at_every_image_size(size):
    image = {"image": torch.randn(2, 4, size, size)}
    assert_equivariant(vision_encoder(size=size), image, D4, act_on_hidden(D4), function=part_of("image"))


@network_and_baseline
@pytest.mark.parametrize("size", IMAGE_SIZES)
def test_vision_gives_one_vector_that_sees_every_part_of_the_image(group, size):
    image = torch.randn(4, 4, size, size, requires_grad=True)
    features = VisionEncoder(layer_factory(group), (4,) * 6, latent=4, size=size)(image)
    assert features.shape == (4, 4 * layer_factory(group).copies)
    features.sum().backward()
    assert image.grad is not None
    reached = image.grad.abs().sum((0, 1)).unflatten(0, (4, -1)).unflatten(2, (4, -1)).sum((1, 3))  # of sixteen patches
    assert (reached > 0).all()


@torch.no_grad()
def test_at_45_degrees_convolutions_are_nearly_right_and_the_encoder_is_not():
    """Smooth pictures, away from the edge: interpolation costs a convolution little; pooling then spoils it."""
    group, turn = GROUPS["D8"], element(45)
    place = torch.linspace(-1, 1, 64)
    waves = [torch.sin(3 * place + k)[:, None] * torch.cos(2 * place - k) for k in range(8)]
    image = {"image": torch.stack(waves).reshape(2, 4, 64, 64)}
    encoder = vision_encoder(group)
    before, after = (map_after(0)(encoder, b) for b in (image, act_on_batch(turn, image)))
    right, wrong = (
        float((after - action(turn, before))[..., 16:48, 16:48].norm() / before[..., 16:48, 16:48].norm())
        for action in (act_on_feature_map(group), act_on_image)
    )
    assert right < 0.02
    assert wrong > 10 * right
    (whole,) = equivariance_error(lambda b: encoder(b["image"]), image, group, act_on_hidden(group), [turn])
    assert 0.02 < whole < 1


@every_group
def test_force_features_are_equivariant_for_life(group):
    """Also at 45 and 30 degrees: there are no pixels."""
    assert_equivariant_for_life(
        lambda: force_encoder(group), wrenches(), group, act_on_hidden(group), part_of("wrench")
    )


@pytest.mark.parametrize("window", [1, 7, 64, 128])
def test_force_features_are_equivariant_for_any_window(window):
    encoder = force_encoder(window=window)
    assert_equivariant(encoder, wrenches(window), D4, act_on_hidden(D4), function=part_of("wrench"))


@every_group
def test_a_polar_torque_breaks_exactly_the_reflections(group):
    encoder = force_encoder(group, "polar")
    errors = equivariance_error(lambda batch: encoder(batch["wrench"]), wrenches(), group, act_on_hidden(group))
    assert max(errors[: group.rotations]) < 1e-5
    if group.mirrors:
        assert min(errors[group.rotations :]) > 0.05
        with pytest.raises(AssertionError, match="not equivariant"):
            assert_equivariant(encoder, wrenches(), group, act_on_hidden(group), function=part_of("wrench"))


class SlippedAttention(SelfAttention):
    """The published slip: a reshape that takes the channel order to be (group element, field)."""

    def forward(self, x):
        x = super().forward(x)
        return x.unflatten(-1, (x.shape[-1] // 4, 4)).transpose(-1, -2).flatten(-2)


@every_group
def test_the_published_reshape_slip_is_caught(group):
    encoder = force_encoder(group)
    assert_equivariant(encoder, wrenches(), group, act_on_hidden(group), function=part_of("wrench"))
    encoder.attention.__class__ = SlippedAttention
    errors = equivariance_error(lambda batch: encoder(batch["wrench"]), wrenches(), group, act_on_hidden(group))
    assert min(errors[1:]) > 0.1
    with pytest.raises(AssertionError, match="not equivariant"):
        assert_equivariant(encoder, wrenches(), group, act_on_hidden(group), function=part_of("wrench"))


@network_and_baseline
@pytest.mark.parametrize("window", [1, 7, 64, 128])
def test_every_reading_reaches_the_output(group, window):
    encoder = ForceEncoder(layer_factory(group), WRENCH_PARTS, window, width=8, heads=2, latent=6)
    wrench = torch.randn(8, window, 6, requires_grad=True)
    encoder(wrench).square().sum().backward()
    assert wrench.grad is not None
    reached = wrench.grad.abs().sum(dim=0)  # (T, 6)
    assert reached.shape == (window, 6)
    assert (reached > 0).all()


def test_the_order_of_the_readings_matters_to_attention():
    encoder = force_encoder(window=64)
    embedded = torch.relu(encoder.embed(stored(WRENCH_PARTS, wrenches(64)["wrench"])))
    mixed = encoder.attention(embedded + encoder.position)
    turned = encoder.attention(embedded.flip(1) + encoder.position).flip(1)
    assert not torch.allclose(mixed, turned, atol=1e-3)


def test_position_codes_differ_between_readings_and_are_bounded():
    code = position_encoding(64, 8)
    assert torch.unique(code, dim=0).shape[0] == 64
    assert code.abs().max() <= 1


@every_group
def test_proprio_features_are_equivariant_for_life(group, grippers):
    """A turned scene: (x, y) about the centre, the yaw by the angle."""
    grippers = {"proprio": grippers["proprio"] * torch.tensor([1, 5, 5, 5, 1])}
    assert_equivariant_for_life(
        lambda: proprio_encoder(group), grippers, group, act_on_hidden(group), part_of("proprio")
    )


@network_and_baseline
def test_a_gripper_after_half_a_turn_is_the_same_gripper(group, grippers):
    """Its two fingers are alike; after a quarter turn they are not where they were."""
    encoder, proprio = proprio_encoder(group), grippers["proprio"]
    yaw = torch.tensor([0, 0, 0, 0, torch.pi])
    torch.testing.assert_close(encoder(proprio + yaw), encoder(proprio), atol=1e-5, rtol=1e-5)
    assert not torch.allclose(encoder(proprio + yaw / 2), encoder(proprio), atol=1e-2)


def test_a_turned_scene_is_not_a_turned_gripper(grippers):
    """Turning the gripper alone, the scene left as it is, does not merely permute the features."""
    encoder, proprio = proprio_encoder(), grippers["proprio"] * torch.tensor([1, 5, 5, 5, 1])
    quarter = element(90)
    scene = act_on_batch(quarter, {"proprio": proprio})["proprio"]
    gripper = torch.cat([proprio[:, :4], scene[:, 4:]], dim=1)
    moved = act_on_hidden(D4)(quarter, encoder(proprio))
    torch.testing.assert_close(encoder(scene), moved, atol=1e-5, rtol=1e-5)
    assert not torch.allclose(encoder(gripper), moved, atol=1e-2)


@network_and_baseline
def test_every_component_of_the_gripper_reaches_the_output(group, grippers):
    proprio = grippers["proprio"].clone().requires_grad_()
    VectorEncoder(layer_factory(group), (8, 8, 8), latent=8)(proprio).square().sum().backward()
    assert proprio.grad is not None
    assert (proprio.grad.abs().sum(dim=0) > 0).all()
    assert proprio.shape[-1] == sum(len(part.index) for part in PROPRIO_PARTS)


class Fused(nn.Module):
    def __init__(self, group):
        super().__init__()
        self.force, self.proprio = force_encoder(group), proprio_encoder(group)
        self.fusion = Fusion(layer_factory(group), encoders=2, latent=3)

    def forward(self, batch):
        return self.fusion([self.force(batch["wrench"]), self.proprio(batch["proprio"])])


@every_group
def test_fusion_is_equivariant_for_life(group, grippers):
    batch = wrenches() | {"proprio": grippers["proprio"][:4]}
    assert_equivariant_for_life(lambda: Fused(group), batch, group, act_on_hidden(group))
