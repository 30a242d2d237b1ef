import dataclasses

import pytest
import torch

from svfl_data.errors import TrainingError
from svfl_models.latent.config import MODALITIES, MODELS, PRESETS, Sizes
from svfl_models.latent.networks.network import ENCODERS, LatentNetwork
from svfl_models.latent.networks.trunks import WrenchTrunk
from svfl_models.latent.networks.vtt import VTTEncoder
from svfl_models.training.trainer import parameter_count
from tests.helpers.latent_small import SIZES, frames, network


def said(model: str, seen: dict[str, torch.Tensor]) -> torch.Tensor:
    encoding = network(model).encode(seen)
    return torch.cat([encoding.feature, encoding.contact[:, None], encoding.alignment[:, None]], dim=1)


@pytest.mark.parametrize("model", MODELS)
def test_every_reading_pixel_and_component_matters(model):
    seen = {name: values.requires_grad_() for name, values in frames(2).items()}
    answer = said(model, seen)
    assert answer.shape == (2, SIZES.feature + 2)
    direction = torch.randn(answer.shape, generator=torch.Generator().manual_seed(1))
    (answer * direction).sum().backward()
    wrench = seen["wrench"].grad
    assert (wrench.abs() > 1e-9).all()  # all 64 readings, all six components
    assert wrench.abs().amax(dim=(0, 2)).min() > 1e-3 * wrench.abs().max()  # and none of them as good as not at all
    assert (seen["proprio"].grad != 0).all()
    assert (seen["image"].grad != 0).float().mean() > 0.999


def test_a_strided_convolution_that_pads_would_not_pass():
    """The published force encoder reads its oldest input only; the same test finds it out."""
    liar = torch.nn.Sequential(*(torch.nn.Conv1d(6, 6, 2, stride=2, padding=1) for _ in range(6)))
    wrench = frames(1)["wrench"].transpose(1, 2).requires_grad_()
    liar(wrench)[..., 0].sum().backward()
    assert (wrench.grad != 0).any(dim=1).sum() == 1


@pytest.mark.parametrize("model", MODELS)
def test_contact_and_alignment_have_the_same_order_in_every_encoder(model):
    encoder, seen = network(model).encoder, network(model).inputs(frames())
    encoder.contact.bias.data.fill_(100.0)
    encoder.alignment.bias.data.fill_(-100.0)
    encoding = encoder(seen)
    assert (encoding.contact > 50).all()  # logits, not probabilities
    assert (encoding.alignment < -50).all()
    assert encoding.contact.shape == encoding.alignment.shape == (3,)


@pytest.mark.parametrize("model", MODELS)
def test_frames_are_encoded_each_for_itself(model):
    whole, alone = said(model, frames(3)), {name: values[1:2] for name, values in frames(3).items()}
    torch.testing.assert_close(whole[1:2], said(model, alone))


@pytest.mark.parametrize("model", MODELS)
def test_evaluation_is_deterministic(model):
    torch.testing.assert_close(said(model, frames()), said(model, frames()), rtol=0, atol=0)


def test_poe_draws_in_training_only():
    poe = network("poe", train=True)
    assert not torch.equal(poe.encode(frames()).feature, poe.encode(frames()).feature)


@pytest.mark.parametrize("model", ["vtt", "concat"])
def test_a_missing_modality_is_an_error_where_it_is_needed(model):
    seen = frames()
    del seen["wrench"]
    with pytest.raises(TrainingError, match=r"image, wrench, proprio.* missing: wrench"):
        network(model).encode(seen)


@pytest.mark.parametrize("model", MODELS)
def test_a_foreign_wrench_is_joined_without_a_second_look(model):
    net = network(model)
    inputs = net.inputs(frames())
    parts, turned = net.encoder.parts(inputs), torch.tensor([1, 2, 0])
    joined = net.encoder.join(parts | {"wrench": parts["wrench"][turned]})
    torch.testing.assert_close(joined.feature, net.encoder(inputs | {"wrench": inputs["wrench"][turned]}).feature)


def test_sizes_that_do_not_fit_the_observation_are_refused():
    with pytest.raises(TrainingError, match="14 px"):
        VTTEncoder(dataclasses.replace(SIZES, patch=14))
    with pytest.raises(TrainingError, match=r"5 layers .*32 readings.* 64"):
        WrenchTrunk((4,) * 5, 4)
    with pytest.raises(TrainingError, match=r"model 'svfl'.* vtt, poe, concat"):
        LatentNetwork("svfl")
    with pytest.raises(TrainingError, match=r"'wrench' .*\(3, 32, 6\).* 64, 6\)"):
        network("poe").encode(frames() | {"wrench": torch.zeros(3, 32, 6)})


def test_attention_of_a_block_is_what_it_mixes_with():
    block = network("vtt").encoder.blocks[0]
    x = torch.randn(2, 5, SIZES.dim, generator=torch.Generator().manual_seed(0))
    weights = block.attention(x)
    torch.testing.assert_close(weights.sum(dim=-1), torch.ones(2, SIZES.heads, 5))
    value = block.query_key_value(block.first(x)).unflatten(-1, (3, SIZES.heads, -1))[:, :, 2].transpose(1, 2)
    after = x + block.out((weights @ value).transpose(1, 2).flatten(2))
    torch.testing.assert_close(block(x), after + block.perceptron(block.second(after)))


def test_the_encoders_are_named_once():
    assert tuple(ENCODERS) == MODELS
    assert MODALITIES == ("image", "wrench", "proprio")


def test_the_published_transformer_is_this_one_up_to_its_inputs():
    """11,933,602 parameters for 36 patches of 3 x 14 x 14 and 2 tokens of one reading; the rest is counted here."""
    sizes = Sizes()
    tokens, dim = 2 + 16 + 64 // sizes.readings + 1, sizes.dim
    published = 11_933_602 - (3 * 14 * 14 + 1) * dim - (6 + 1) * 2 * dim - 40 * (dim + 32 * sizes.joined)
    inputs = (4 * 16 * 16 + 1) * dim + (6 * sizes.readings + 1) * dim + (6 + 1) * dim
    assert parameter_count(VTTEncoder(sizes)) == published + inputs + tokens * (dim + 32 * sizes.joined)
    assert PRESETS["vtt_2022"].sizes == sizes


def test_attention_is_that_of_pytorch():
    block, tokens = VTTEncoder(SIZES).blocks[0], torch.randn(3, 7, SIZES.dim)
    seen: list[torch.Tensor] = []
    block.out.register_forward_pre_hook(lambda _, given: seen.append(given[0]))
    block(tokens)
    heads = block.query_key_value(block.first(tokens)).reshape(3, 7, 3, SIZES.heads, -1).permute(2, 0, 3, 1, 4)
    expected = torch.nn.functional.scaled_dot_product_attention(*heads)
    torch.testing.assert_close(seen[0], expected.transpose(1, 2).reshape(3, 7, -1))


def test_patches_are_those_of_the_convolution():
    encoder, image = VTTEncoder(SIZES), torch.randn(2, 4, 64, 64)
    tokens = encoder.parts({"image": image, "wrench": torch.zeros(2, 64, 6), "proprio": torch.zeros(2, 6)})["image"]
    assert (
        tokens - encoder.image(image).flatten(2).transpose(1, 2)
    ).abs().max() < 1e-4  # sums of 1,024 products in another order
