import math

import pytest
import torch
from torch.distributions import Normal

from svfl_data.errors import TrainingError
from svfl_models.latent.config import MODELS, PRESETS, TERMS, LatentConfig
from svfl_models.latent.losses import SIGMA, Objective
from svfl_models.latent.networks.decoder import DEPTH_UNIT
from svfl_models.latent.networks.portion import Portion
from tests.helpers.latent_small import SIZES, batch, network

ALL = dict.fromkeys(TERMS, 1.0)


def terms(model="poe", drawn=None, objective=None):
    torch.manual_seed(0)
    return (objective or Objective(ALL, [])).terms(network(model), drawn or batch())


@pytest.mark.parametrize("model", MODELS)
def test_all_terms_are_there_and_finite(model):
    found = terms(model)
    assert tuple(found) == tuple(name for name in TERMS if model == "poe" or name != "expert_kl")
    assert all(torch.isfinite(term.mean) for term in found.values())


def test_a_sum_is_the_mean_times_the_elements_of_a_sequence():
    found, frames = terms(), batch()["image"].shape[1]
    assert {name: term.elements for name, term in found.items()} == {
        "image": frames * 3 * 64 * 64, "depth": frames * 64 * 64, "kl": frames * SIZES.z1,
        "expert_kl": frames * SIZES.feature, "reward": frames - 1, "contact": frames, "next_contact": frames - 1,
        "alignment": frames, "mismatch": 1, "next_proprio": (frames - 1) * 6,
    }  # fmt: skip
    kl = found["kl"]
    torch.testing.assert_close(Objective({"kl": 0.5}, ["kl"]).weighted("kl", kl), 0.5 * kl.elements * kl.mean)
    torch.testing.assert_close(Objective({"kl": 0.5}, []).weighted("kl", kl), 0.5 * kl.mean)


def test_pictures_are_scored_by_the_density_of_a_normal_distribution():
    drawn, net = batch(), network("concat")
    shown = net.picture(net(drawn).states.state)
    found = Objective(ALL, []).terms(net, drawn)
    log = Normal(shown, torch.tensor([1, 1, 1, DEPTH_UNIT])[:, None, None] * SIGMA).log_prob(drawn["image"])
    assert found["image"].mean.item() == pytest.approx(-log[:, :, :3].mean().item(), rel=1e-4)
    per_unit = -log[:, :, 3].mean().item() - math.log(
        DEPTH_UNIT
    )  # the density is per unit of the output, not per metre
    assert found["depth"].mean.item() == pytest.approx(per_unit, rel=1e-4)


def test_pixels_without_depth_do_not_count():
    drawn, net = batch(), network("concat")
    drawn["image"][:, :, 3, :32] = 0.0
    found = Objective(ALL, []).terms(net, drawn)
    shown = net.picture(net(drawn).states.state)[:, :, 3, 32:]
    error = (shown - drawn["image"][:, :, 3, 32:]) / DEPTH_UNIT / SIGMA
    expected = 0.5 * error.square().mean() + math.log(SIGMA) + 0.5 * math.log(2 * math.pi)
    assert found["depth"].mean.item() == pytest.approx(expected.item(), rel=1e-4)


def test_the_last_action_may_be_rewarded():
    """A mask of ends, as the published code has, would hide the only reward there is."""
    drawn, net = batch(), network("concat")
    drawn["reward"] = torch.zeros_like(drawn["reward"])
    before = Objective(ALL, []).terms(net, drawn)["reward"].mean
    drawn["reward"][:, -1] = 1.0
    assert not torch.equal(Objective(ALL, []).terms(net, drawn)["reward"].mean, before)


def test_right_and_wrong_pairs_pull_the_same_logit_apart_in_one_step():
    net = network("concat")
    found = Objective({"alignment": 1.0, "mismatch": 1.0}, [], negatives=4).terms(net, batch())
    right, wrong = (
        torch.autograd.grad(found[name].mean, net.encoder.alignment.bias, retain_graph=True)[0] for name in found
    )
    assert right < 0 < wrong
    wrench = next(net.encoder.trunks["wrench"].parameters())
    assert torch.autograd.grad(found["mismatch"].mean, wrench)[0].abs().sum() > 0


def test_a_batch_that_touches_nothing_has_no_wrong_pairs_and_no_nan():
    drawn = batch()
    drawn["touching"] = torch.zeros_like(drawn["touching"])
    assert terms(drawn=drawn)["mismatch"].mean.item() == 0.0


def test_what_weighs_nothing_is_not_computed(monkeypatch):
    net = network("concat")
    monkeypatch.setattr(net.decoder, "forward", lambda state: pytest.fail("decoded"))
    assert set(Objective({"kl": 1.0, "image": 0.0}, []).terms(net, batch())) == {"kl"}


def test_unknown_terms_are_refused():
    with pytest.raises(TrainingError, match=r"term flow.* image, depth, kl"):
        Objective({"flow": 10.0}, [])


@pytest.mark.parametrize("preset", PRESETS)
def test_presets_weigh_known_terms_and_are_plain(preset):
    config = LatentConfig("data", "poe", preset)
    assert set(PRESETS[preset].weights) == set(TERMS)
    assert Objective(**config.objective()).weights == PRESETS[preset].weights
    assert all(isinstance(value, int | list) for value in config.network()["sizes"].values())


def gradients(model, drawn, portions):
    """Terms of a training step and the gradients of their sum, as means over portions weighted by their sequences."""
    net, found = network(model, train=True).double(), dict.fromkeys(TERMS, 0.0)
    for portion in portions:
        torch.manual_seed(0)
        seen = Objective(ALL, []).terms(net, drawn, portion)
        weight = 1.0 if portion is None else 1 / portion.scale
        (weight * torch.stack([term.mean for term in seen.values()]).sum()).backward()
        found |= {name: found[name] + weight * term.mean.item() for name, term in seen.items()}
    return found, {name: one.grad for name, one in net.named_parameters() if one.grad is not None}


@pytest.mark.parametrize("touching", [slice(0, 5), slice(3, 5)], ids=["all in contact", "some in contact"])
@pytest.mark.parametrize("model", MODELS)
def test_portions_of_a_batch_have_its_terms_and_gradients(model, touching):
    """Whatever another portion has: pixels without depth, the wrench of a pair, all pairs."""
    drawn = {name: value.double() if value.is_floating_point() else value for name, value in batch(5).items()}
    drawn["image"][0, :, 3, :50] = 0.0
    drawn["touching"] = torch.zeros_like(drawn["touching"])
    drawn["touching"][touching] = True
    whole, expected = gradients(model, drawn, [None])
    found, gradient = gradients(model, drawn, [Portion(0, 1, 5), Portion(1, 3, 5), Portion(3, 5, 5)])
    assert found == pytest.approx(whole, rel=1e-9)
    assert gradient.keys() == expected.keys()
    for name, one in gradient.items():
        torch.testing.assert_close(one, expected[name], rtol=1e-8, atol=1e-12)


def test_a_portion_that_draws_its_own_numbers_would_not_pass():
    drawn = {name: value.double() if value.is_floating_point() else value for name, value in batch(4).items()}
    whole, _ = gradients("poe", drawn, [None])
    own = [{name: value[rows] for name, value in drawn.items()} for rows in (slice(0, 2), slice(2, 4))]
    alone = [gradients("poe", one, [None])[0]["kl"] for one in own]
    assert abs(sum(alone) / 2 - whole["kl"]) > 1e-3 * abs(whole["kl"])
