import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch.distributions import Normal, kl_divergence

from svfl_data.errors import TrainingError
from svfl_models.latent.config import MODALITIES
from svfl_models.latent.networks.gaussian import SMALLEST, Gaussian, product
from tests.helpers.latent_small import frames, network

NUMBERS = st.lists(st.tuples(st.floats(-3, 3), st.floats(0.05, 5)), min_size=1, max_size=4)


def gaussians(numbers):
    return [Gaussian(torch.tensor([mean]).double(), torch.tensor([variance]).double()) for mean, variance in numbers]


@given(NUMBERS)
@settings(max_examples=40, deadline=None)
def test_the_product_is_the_closed_form_and_the_density_itself(numbers):
    experts = gaussians(numbers)
    made = product(experts)
    precision = sum(1 / variance for _, variance in numbers)
    assert float(made.variance) == pytest.approx(1 / precision, rel=1e-5)
    assert float(made.mean) == pytest.approx(sum(mean / v for mean, v in numbers) / precision, rel=1e-5, abs=1e-6)

    x = torch.linspace(-20, 20, 20_001, dtype=torch.float64)
    log = sum(Normal(one.mean, one.variance.sqrt()).log_prob(x) for one in experts)
    density = (log - log.max()).exp()
    mean = (x * density).sum() / density.sum()
    assert float(made.mean) == pytest.approx(float(mean), abs=1e-4)
    assert float(made.variance) == pytest.approx(float(((x - mean).square() * density).sum() / density.sum()), rel=1e-3)


@given(NUMBERS, NUMBERS)
@settings(max_examples=20, deadline=None)
def test_products_can_be_made_in_any_order_and_in_parts(first, second):
    one, other = product(gaussians(first + second)), product(gaussians(second + first))
    parts = product([product(gaussians(first)), product(gaussians(second))])
    for made in (other, parts):
        torch.testing.assert_close(made.mean, one.mean)
        torch.testing.assert_close(made.variance, one.variance)


def test_divergence_is_that_of_the_library():
    rng = torch.Generator().manual_seed(0)
    a, b = (Gaussian(torch.randn(5, generator=rng), torch.rand(5, generator=rng) + 0.1) for _ in range(2))
    expected = kl_divergence(Normal(a.mean, a.variance.sqrt()), Normal(b.mean, b.variance.sqrt()))
    torch.testing.assert_close(a.kl(b), expected)
    assert a.kl(a).abs().max() < 1e-6


def test_samples_have_mean_and_variance():
    drawn = Gaussian(torch.full((100_000,), 2.0), torch.full((100_000,), 0.25)).sample()
    assert float(drawn.mean()) == pytest.approx(2.0, abs=0.01)
    assert float(drawn.var()) == pytest.approx(0.25, rel=0.02)


def test_no_expert_can_silence_the_others():
    assert float(Gaussian.of(torch.tensor([0.0, -1e9])).variance) == pytest.approx(SMALLEST)


@pytest.mark.parametrize("present", [(a,) for a in MODALITIES] + [MODALITIES[:2], MODALITIES[1:], MODALITIES])
def test_a_subset_of_modalities_is_the_product_of_their_experts_and_the_prior(present):
    net, seen = network("poe"), frames()
    encoder = net.encoder
    experts = encoder.experts(encoder.parts(net.inputs(seen)))
    expected = product([experts[name] for name in (*present, "prior")])
    encoding = net.encode({name: seen[name] for name in present})
    torch.testing.assert_close(encoding.posterior.mean, expected.mean)
    torch.testing.assert_close(encoding.posterior.variance, expected.variance)
    torch.testing.assert_close(encoding.feature, encoder.norm(expected.mean))  # the mean, in evaluation
    assert (encoding.posterior.variance < experts["prior"].variance).all()


def test_an_expert_that_knows_nothing_changes_nothing():
    net, seen = network("poe"), frames()
    with torch.no_grad():
        last = net.encoder.trunks["wrench"].last
        last.weight[16:], last.bias[16:] = 0.0, 1e9  # its variance
    both = net.encode(seen).posterior
    alone = net.encode({name: values for name, values in seen.items() if name != "wrench"}).posterior
    torch.testing.assert_close(both.mean, alone.mean)


def test_no_modality_at_all_is_an_error():
    with pytest.raises(TrainingError, match=r"modality.* image, wrench, proprio"):
        network("poe").encode({})
