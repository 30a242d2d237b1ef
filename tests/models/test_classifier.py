import numpy as np
import pytest
import torch
from torch.nn import functional

from svfl_data.errors import TrainingError
from svfl_data.symmetry import act_on_direction, dihedral
from svfl_models.classifier import CenteringClassifier, parameter_count
from svfl_models.config import ENCODERS, MODELS
from svfl_models.presets import PRESETS
from svfl_models.testing import act_on_batch, act_on_hidden, act_on_scores, assert_equivariant, equivariance_error


def classifier(samples, **options):
    network = CenteringClassifier(**options)
    network.normalization.fit(samples.image, samples.wrench)
    return network


def take_a_step(network, batch):
    optimizer = torch.optim.Adam(network.parameters(), lr=1e-2)
    functional.cross_entropy(network(batch), torch.arange(8) % 4).backward()
    optimizer.step()


@pytest.mark.parametrize("encoder", ENCODERS)
def test_symmetric_before_and_after_a_training_step_and_a_round_trip(encoder, samples, batch, tmp_path):
    network = classifier(samples, encoder=encoder)
    assert_equivariant(network, batch)
    assert_equivariant(network, batch, act_on_hidden(), function=CenteringClassifier.features)
    before = network(batch)
    take_a_step(network, batch)
    assert not torch.allclose(network(batch), before, rtol=1e-3)
    assert_equivariant(network, batch)

    torch.save(network.eval().state_dict(), tmp_path / "weights.pt")
    loaded = CenteringClassifier(encoder=encoder)
    loaded.load_state_dict(torch.load(tmp_path / "weights.pt", weights_only=True))
    torch.testing.assert_close(loaded(batch), network(batch))
    assert_equivariant(loaded, batch)


def test_the_scores_follow_the_label(samples):
    """What the network says of a moved sample is where the label moves."""
    scores = torch.eye(4)
    for g in dihedral(4):
        assert act_on_scores(g, scores).argmax(dim=1).tolist() == act_on_direction(g, np.arange(4)).tolist()
    moved = act_on_batch(dihedral(4)[1], {"direction": torch.tensor([0, 1, 2, 3])})
    assert moved["direction"].tolist() == [1, 2, 3, 0]


@pytest.mark.parametrize("options", [{"model": "cnn"}, {"torque": "polar"}])
def test_a_network_without_the_symmetry_is_caught(options, samples, batch):
    network = classifier(samples, **options)
    take_a_step(network, batch)
    assert max(equivariance_error(network, batch, act_on_scores)) > 1e-2
    with pytest.raises(AssertionError, match="not equivariant"):
        assert_equivariant(network, batch)


def test_a_normalization_with_a_scale_of_its_own_for_x_and_y_is_caught(samples, batch):
    network = classifier(samples)
    network.normalization.wrench_scale[0] *= 2
    with pytest.raises(AssertionError, match="not equivariant"):
        assert_equivariant(network, batch)


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("encoder", ENCODERS)
def test_twins_have_comparable_parameter_counts(preset, encoder):
    svfl, cnn = (parameter_count(CenteringClassifier(encoder, model, preset)) for model in MODELS)
    assert abs(cnn - svfl) < 0.1 * svfl


def test_the_paper_preset_has_the_size_of_the_reference():
    network = CenteringClassifier("vf", "svfl", "paper")
    assert network.vision is not None
    assert network.force is not None
    assert parameter_count(network.vision) == 1_112_632  # measured on the reference implementation
    assert parameter_count(network.force) == 1_081_760
    assert parameter_count(network) == pytest.approx(2.3e6, rel=0.01)  # the paper's figure


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"encoder": "fv"}, "unknown encoder 'fv'; possible: v, f, vf"),
        ({"model": "mlp"}, "unknown model 'mlp'; possible: svfl, cnn"),
        ({"preset": "big"}, "unknown preset 'big'; possible: paper, default"),
    ],
)
def test_unknown_choices(options, message):
    with pytest.raises(TrainingError, match=message):
        CenteringClassifier(**options)


def test_inputs_the_network_was_not_built_for(batch):
    network = CenteringClassifier()
    with pytest.raises(TrainingError, match=r"'wrench' has shape \(8, 32, 6\); .* built for \(B, 64, 6\)"):
        network(batch | {"wrench": batch["wrench"][:, :32]})
    with pytest.raises(TrainingError, match="the batch has no 'image'; it has wrench"):
        network({"wrench": batch["wrench"]})
