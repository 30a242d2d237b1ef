import pytest
import torch
from torch.nn import functional

from svfl_data.errors import TrainingError
from svfl_data.symmetry import OFFSET_PARTS
from svfl_models.centering.classifier import CenteringClassifier
from svfl_models.networks.inputs import ENCODERS
from svfl_models.networks.presets import PRESETS
from svfl_models.symmetry.actions import act_on_hidden, act_on_parts, act_on_scores
from svfl_models.symmetry.groups import GROUPS
from svfl_models.symmetry.testing import assert_equivariant, equivariance_error
from svfl_models.training.trainer import parameter_count
from tests.helpers.lifetime import TRIED, assert_equivariant_for_life, named

ACTIONS = {"direction": act_on_scores, "offset": act_on_parts(OFFSET_PARTS)}
every_group = pytest.mark.parametrize("group", TRIED, ids=named)


def classifier(samples, **options):
    network = CenteringClassifier(**options)
    network.fit(samples)
    return network


def features(network, batch):
    return network.trunk(batch)


def take_a_step(network, batch):
    optimizer = torch.optim.Adam(network.parameters(), lr=1e-2)
    functional.cross_entropy(network(batch), torch.arange(8) % 4).backward()
    optimizer.step()


@pytest.fixture(scope="module")
def coarse(batch):
    """Few, small pictures and short windows."""
    return {"image": batch["image"][:4, :, ::8, ::8], "wrench": batch["wrench"][:4, ::8]}


@pytest.mark.slow
@every_group
@pytest.mark.parametrize(
    ("encoder", "target"), [("v", "direction"), ("f", "direction"), ("vf", "direction"), ("vf", "offset")]
)
def test_symmetric_for_life(encoder, target, group, samples, coarse):
    def build():
        return classifier(
            samples, encoder=encoder, group=group.name, preset="tiny", target=target, image_size=8, window=8
        )

    assert_equivariant_for_life(build, coarse, group, ACTIONS[target])


@every_group
@pytest.mark.parametrize("target", ACTIONS)
def test_what_is_felt_alone_may_turn_by_any_element(group, target, samples, coarse):
    """Hidden features and offsets; four directions only by quarter turns, and the check knows that."""
    network = classifier(samples, encoder="f", group=group.name, preset="tiny", target=target, window=8)
    wrench = {"wrench": coarse["wrench"]}
    assert_equivariant(network, wrench, group, ACTIONS[target])
    assert_equivariant(network, wrench, group, act_on_hidden(group), function=features)
    assert len(equivariance_error(lambda b: network.trunk(b), wrench, group, act_on_hidden(group))) == len(group)


@pytest.mark.slow
@pytest.mark.parametrize("encoder", ENCODERS)
def test_the_default_network_is_symmetric_before_and_after_a_training_step(encoder, samples, batch):
    network = classifier(samples, encoder=encoder)
    assert_equivariant(network, batch)
    assert_equivariant(network, batch, act_on_output=act_on_hidden(), function=features)
    take_a_step(network, batch)
    assert_equivariant(network, batch)


def test_a_loaded_network_brings_its_statistics(samples, batch, tmp_path):
    network, loaded = classifier(samples, target="offset"), CenteringClassifier(target="offset")
    torch.save(network.state_dict(), tmp_path / "weights.pt")
    loaded.load_state_dict(torch.load(tmp_path / "weights.pt", weights_only=True))
    torch.testing.assert_close(loaded(batch), network(batch))


@pytest.mark.parametrize("options", [{"group": "none"}, {"torque": "polar"}])
def test_a_network_without_the_symmetry_is_caught(options, samples, batch):
    network = classifier(samples, **options)
    take_a_step(network, batch)
    assert max(equivariance_error(network, batch)) > 1e-2
    with pytest.raises(AssertionError, match="not equivariant"):
        assert_equivariant(network, batch)


def test_rotations_alone_do_not_make_a_mirror(samples, batch):
    """C4 networks know quarter turns, and no flips."""
    network = classifier(samples, group="C4")
    assert_equivariant(network, batch, GROUPS["C4"])
    errors = equivariance_error(network, batch, GROUPS["D4"])
    assert max(errors[:4]) < 1e-5
    assert min(errors[4:]) > 1e-2


def test_a_normalization_with_a_scale_of_its_own_for_x_and_y_is_caught(samples, batch):
    network = classifier(samples)
    network.trunk.normalization.scale("wrench")[0] *= 2
    with pytest.raises(AssertionError, match="not equivariant"):
        assert_equivariant(network, batch)


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("encoder", ENCODERS)
def test_twins_have_comparable_parameter_counts(preset, encoder):
    svfl, cnn = (parameter_count(CenteringClassifier(encoder, group, preset)) for group in ("D4", "none"))
    assert cnn == pytest.approx(svfl, rel=0.1)


def test_the_paper_preset_has_the_size_of_the_reference():
    network = CenteringClassifier("vf", "D4", "paper")
    vision, force = network.trunk.encoders
    assert parameter_count(vision) == 1_112_632  # measured on the reference implementation
    assert parameter_count(force) == 1_081_760
    assert parameter_count(network) == pytest.approx(2.29e6, rel=0.005)  # the paper's figure is 2.3e6


@pytest.mark.parametrize(
    ("options", "facts"),
    [
        ({"encoder": "fv"}, "encoder 'fv'.* v, f, vf"),
        ({"group": "D5"}, "group 'D5'.* D4, C4, C8, D8, D12, none"),
        ({"preset": "big"}, "preset 'big'.* tiny, default, wide, paper"),
        ({"target": "class"}, "target 'class'.* direction, offset"),
        ({"image_size": 48}, "image size 48.* 8, 16, 32, 64, 128"),
        ({"torque": "none"}, "torque .*'none'.* axial, polar"),
    ],
)
def test_unknown_choices(options, facts):
    with pytest.raises(TrainingError, match=facts):
        CenteringClassifier(**options)


def test_inputs_the_network_was_not_built_for(batch):
    network = CenteringClassifier()
    with pytest.raises(TrainingError, match=r"'wrench' .*\(8, 32, 6\).* \(B, 64, 6\)"):
        network(batch | {"wrench": batch["wrench"][:, :32]})
    with pytest.raises(TrainingError, match=r"no 'image'.* wrench"):
        network({"wrench": batch["wrench"]})
