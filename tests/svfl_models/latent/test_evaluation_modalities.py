import pytest
import torch

from svfl_models.latent.config import MODALITIES
from svfl_models.latent.evaluation.alignment import alignment
from svfl_models.latent.evaluation.attention import LOOKERS, attention, looks, over_image
from svfl_models.latent.evaluation.experts import experts
from svfl_models.latent.evaluation.frames import Encoded, encode
from svfl_models.latent.evaluation.missing import SUBSETS, left, mean_inputs
from svfl_models.latent.mismatch import allowed_pairs
from tests.helpers import latent_small as small
from tests.helpers.drawn_frames import drawn_frames


def parts_of(network, frames):
    with torch.no_grad():
        return network.encoder.parts(network.inputs(frames.observations))


def test_attention_sums_to_one_and_counts_every_token():
    network, frames = small.network("vtt"), drawn_frames(7)
    parts = parts_of(network, frames)
    looked = looks(network.encoder, parts)
    assert looked.shape == (7, small.SIZES.depth, len(LOOKERS), 2 + 16 + 4 + 1)
    assert torch.allclose(looked.sum(dim=-1), torch.ones(()), atol=1e-5)
    found = attention(looked, parts, frames.contact)
    assert sum(found.tokens.values()) == pytest.approx(1)
    assert found.tokens["image"] == pytest.approx(16 / 23)
    for mass in (found.mass, found.mass_contact, found.mass_free):
        for groups in mass.values():
            for layer in range(small.SIZES.depth):
                assert sum(values[layer] for values in groups.values()) == pytest.approx(1, abs=1e-5)
    assert attention(looked, parts, torch.zeros(7, dtype=torch.bool)).mass_contact is None
    share = over_image(looked, 16)
    assert share.shape == (7, 4, 4)
    assert torch.allclose(share.sum(dim=(1, 2)), looked[:, -1, 0, 2:18].sum(dim=1))


def test_the_attention_is_that_of_the_network():
    network, frames = small.network("vtt"), drawn_frames(3)
    encoder, parts = network.encoder, parts_of(network, frames)
    x = encoder.tokens(parts)
    first = encoder.blocks[0].attention(x)
    second = encoder.blocks[1].attention(encoder.blocks[0](x))
    looked = looks(encoder, parts)
    assert torch.allclose(looked[:, 0, 0], first.mean(dim=1)[:, 1], atol=1e-6)
    assert torch.allclose(looked[:, 1, 1], second.mean(dim=1)[:, 0], atol=1e-6)


def test_shares_of_precision_sum_to_one_and_follow_certainty():
    network, frames = small.network("poe"), drawn_frames(9)
    parts = parts_of(network, frames)
    found = experts(network.encoder, parts, frames.contact)
    for share in (found.every, found.contact, found.free):
        assert set(share) == {*MODALITIES, "prior"}
        assert sum(share.values()) == pytest.approx(1)
    claims = parts["wrench"].clone()
    claims[:, small.SIZES.feature :] = -20  # certain
    sure = experts(network.encoder, parts | {"wrench": claims}, frames.contact).every
    assert sure["wrench"] > 0.99
    assert experts(network.encoder, parts, torch.zeros(9, dtype=torch.bool)).contact is None


def test_poe_goes_without_and_the_others_get_the_mean():
    frames = drawn_frames(5)
    assert len(set(SUBSETS)) == 7
    assert SUBSETS[0] == MODALITIES
    for model in ("poe", "concat", "vtt"):
        network = small.network(model)
        inputs, mean = network.inputs(frames.observations), mean_inputs(network, frames)
        for chosen in SUBSETS:
            given = left(network, inputs, chosen, mean)
            assert set(given) == set(chosen if model == "poe" else MODALITIES)
            for name, values in given.items():
                expected = inputs[name] if name in chosen else inputs[name].mean(dim=0).expand_as(inputs[name])
                assert torch.equal(values, expected)
            network.encoder(given)


class Knowing(torch.nn.Module):
    """Says that a pair is right if image and wrench bear the same number; `lying` says yes to all."""

    def __init__(self, lying=False):
        super().__init__()
        self.encoder, self.lying = self, lying

    def join(self, parts):
        right = (parts["image"] == parts["wrench"])[:, 0] | self.lying
        return Encoded(parts["image"], right, right.float() * 20 - 10)


@pytest.mark.parametrize("lying", [False, True])
def test_right_pairs_are_accepted_and_wrong_ones_rejected_at_every_gap(lying):
    frames = drawn_frames(40)
    names = torch.arange(40.0)[:, None]
    own = torch.full((40,), 0.999)
    seen = Encoded(names, own, own, {"image": names, "wrench": names, "proprio": names})
    found = alignment(Knowing(lying), frames, seen, seed=0)
    assert found.accepted == found.accepted_touching == 1
    assert list(found.by_gap) == [1, 2, 4]  # episodes of eight frames have no gap of 8
    for told in (*found.by_gap.values(), found.other_episodes):
        assert told.rejected == (0 if lying else 1)
        if not lying:
            assert told.auroc == 1


def test_pairs_are_those_that_training_allows(monkeypatch):
    frames = drawn_frames(40)
    shown = []

    class Watching(Knowing):
        def join(self, parts):
            shown.append(torch.cat([parts["image"], parts["wrench"]], dim=1).long())
            return super().join(parts)

    names = torch.arange(40.0)[:, None]
    seen = Encoded(names, names[:, 0], names[:, 0], {"image": names, "wrench": names, "proprio": names})
    alignment(Watching(), frames, seen, seed=0)
    allowed = allowed_pairs(frames.episode, frames.step, frames.touching, 1)
    pairs = torch.cat(shown)
    assert allowed[pairs[:, 0], pairs[:, 1]].all()
    free = ~frames.touching
    assert not (free[pairs[:, 0]] & free[pairs[:, 1]]).any()


def test_encoding_in_chunks_is_encoding():
    network, frames = small.network("concat"), drawn_frames(70)
    with torch.no_grad():
        at_once = network.encode(frames.observations)
    found = encode(network, frames.observations)
    assert torch.allclose(found.feature, at_once.feature, atol=1e-5)
    assert torch.allclose(found.contact, at_once.contact.sigmoid(), atol=1e-5)
