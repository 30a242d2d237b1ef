import torch

from svfl_models.latent.networks.decoder import DEPTH_UNIT
from svfl_models.latent.networks.dynamics import LatentDynamics
from tests.helpers.latent_small import SIZES, batch, network


def dynamics(train: bool = False) -> LatentDynamics:
    torch.manual_seed(0)
    return LatentDynamics(SIZES).train(train)


def sequences(frames: int = 4):
    rng = torch.Generator().manual_seed(0)
    feature = torch.randn(2, frames, SIZES.feature, generator=rng).requires_grad_()
    return feature, (torch.rand(2, frames - 1, 5, generator=rng) * 2 - 1).requires_grad_()


def test_the_prior_of_a_step_starts_from_the_posterior_before():
    feature, action = sequences()
    states = dynamics()(feature, action)
    states.prior.mean[:, 2].sum().backward()
    assert (feature.grad[:, :2] != 0).any(dim=-1).all()  # what was seen until then
    assert (feature.grad[:, 2:] == 0).all()  # and nothing of what is to be predicted
    assert (action.grad[:, :2] != 0).any(dim=-1).all()
    assert (action.grad[:, 2:] == 0).all()


def test_a_prior_from_its_own_samples_would_not_pass():
    """As the published code steps it: nothing that was seen after the first frame reaches it."""
    feature, action = sequences()
    model = dynamics()
    start = model(feature[:, :1], action[:, :0])
    imagined = model.imagine(start.z2[:, 0], action)
    imagined[:, 1].sum().backward()
    assert (feature.grad[:, 1:] == 0).all()


def test_the_first_prior_is_standard_and_the_shapes_are_as_said():
    states = dynamics()(*sequences())
    assert states.z1.shape == (2, 4, SIZES.z1)
    assert states.state.shape == (2, 4, SIZES.z1 + SIZES.z2)
    assert (states.prior.mean[:, 0] == 0).all()
    assert (states.prior.variance[:, 0] == 1).all()


def test_evaluation_takes_means_and_training_draws():
    feature, action = sequences()
    quiet, loud = dynamics(), dynamics(train=True)
    assert torch.equal(quiet(feature, action).state, quiet(feature, action).state)
    torch.testing.assert_close(quiet(feature, action).z1, quiet(feature, action).posterior.mean)
    assert not torch.equal(loud(feature, action).z1, loud(feature, action).z1)


def test_imagination_is_the_prior_step_by_step():
    feature, action = sequences()
    model = dynamics()
    z2 = model(feature, action).z2[:, 0]
    both, first = model.imagine(z2, action[:, :2]), model.imagine(z2, action[:, :1])
    torch.testing.assert_close(both[:, :1], first)
    second = model.imagine(first[:, 0, SIZES.z1 :], action[:, 1:2])
    torch.testing.assert_close(both[:, 1:], second)


def test_pictures_are_in_physical_units_and_have_no_bounds():
    net = network("concat")
    net.inputs.normalization.mean("image").copy_(torch.tensor([0.2, 0.4, 0.6, 0.8]))
    state = torch.randn(2, 3, SIZES.z1 + SIZES.z2)
    shown, raw = net.picture(state), net.decoder(state.flatten(0, 1))
    assert shown.shape == (2, 3, 4, 64, 64)
    torch.testing.assert_close(shown[:, :, 3].flatten(0, 1), 0.8 + DEPTH_UNIT * raw[:, 3])
    torch.testing.assert_close(shown[:, :, 0].flatten(0, 1), 0.2 + raw[:, 0])
    last = net.decoder.layers[-1]
    with torch.no_grad():
        last.weight.zero_()
        for value in (-5.0, 5.0):  # a last activation would bend one of the two
            last.bias.fill_(value)
            assert (net.decoder(state.flatten(0, 1)) == value).all()


def test_predictions_are_of_the_next_step():
    net, drawn = network("concat"), batch()
    drawn["action"].requires_grad_()
    net(drawn).next_proprio[:, 1].sum().backward()
    assert (drawn["action"].grad[:, 1] != 0).any()
    assert (drawn["action"].grad[:, 2:] == 0).all()
