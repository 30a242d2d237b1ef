"""Block centering on a pretrained latent encoder."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
import torch
from rich.console import Console

from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import TrainingError
from svfl_data.sampling.centering_samples import load_centering
from svfl_models import cli
from svfl_models.centering import pretrained
from svfl_models.centering.checkpoint import configuration
from svfl_models.centering.checkpoint import load_classifier as load_trained
from svfl_models.centering.classifier import CenteringClassifier
from svfl_models.centering.config import USES, TrainingConfig
from svfl_models.centering.data import VIEWS, CenteringData, Crops
from svfl_models.centering.train import train_centering
from svfl_models.deployment.export import inputs
from svfl_models.latent.checkpoint import load_latent
from svfl_models.latent.config import MODELS, plain
from svfl_models.latent.recordings import load_recordings
from svfl_models.networks.inputs import INPUTS
from svfl_models.training import run_folder
from tests.helpers.latent_small import SIZES, lifting, written
from tests.helpers.pretrained import STEPS, write_latent
from tests.helpers.trained import untrained, write

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("drawn")]

QUIET = Console(quiet=True)


@pytest.fixture(scope="module")
def checkpoints(tmp_path_factory):
    folder = tmp_path_factory.mktemp("latents")
    return {model: write_latent(folder / f"{model}.ckpt", model) for model in MODELS}


def config(checkpoint, use="fine-tuned", **changes):
    latent = pretrained.describe(checkpoint, use)
    few = {"train_samples": 8, "test_samples": 12, "epochs": 2}
    return TrainingConfig("drawn", **few | pretrained.settings(latent) | changes)


def trunk_weights(module):
    return {name: value.clone() for name, value in module.classifier.trunk.encoder.state_dict().items()}


def of_all(samples):
    return Crops(samples, INPUTS["vfp"])[list(range(len(samples)))]


@pytest.mark.parametrize("model", MODELS)
def test_a_frozen_encoder_stays_bit_for_bit_and_a_tuned_one_does_not(model, checkpoints, samples, tmp_path):
    before = load_latent(checkpoints[model]).network
    features = before.encode(of_all(samples)).feature
    for use in USES:
        result = train_centering(config(checkpoints[model], use), tmp_path / use, console=QUIET)
        module = load_trained(tmp_path / use / "checkpoint.ckpt")
        same = [torch.equal(value, before.encoder.state_dict()[name]) for name, value in trunk_weights(module).items()]
        assert all(same) == (use == "frozen")
        for name, value in module.classifier.trunk.inputs.state_dict().items():  # nothing is fitted again
            assert torch.equal(value, before.inputs.state_dict()[name])
        head = (SIZES.feature + 1) * 4
        assert result.parameters == head if use == "frozen" else result.parameters > head
        if use == "frozen":
            trunk = module.classifier.trunk
            assert torch.allclose(
                trunk(of_all(samples)) * trunk.feature_scale + trunk.feature_mean, features, atol=1e-5
            )


def test_without_pretraining_the_weights_are_others(checkpoints):
    tuned, scratch = (
        pretrained.module_of(config(checkpoints["poe"], use)).classifier.trunk for use in ("fine-tuned", "from-scratch")
    )
    for name, value in tuned.inputs.state_dict().items():
        assert torch.equal(value, scratch.inputs.state_dict()[name])
    assert not torch.equal(tuned.encoder.trunks["image"].last.weight, scratch.encoder.trunks["image"].last.weight)


@pytest.mark.parametrize("model", MODELS)
def test_a_tuned_encoder_hears_every_modality(model, checkpoints, samples):
    module = pretrained.module_of(config(checkpoints[model])).train()
    module.classifier.fit(samples)
    batch = {
        name: values.requires_grad_() if name in INPUTS["vfp"] else values for name, values in of_all(samples).items()
    }
    module(batch).square().sum().backward()
    for name in INPUTS["vfp"]:
        assert (batch[name].grad != 0).any()
    assert torch.equal(module(batch), module(batch))  # PoE's mean, not a draw, also while it learns


def test_features_are_in_units_of_their_deviation(checkpoints, samples):
    module = pretrained.module_of(config(checkpoints["concat"], "frozen"))
    module.classifier.fit(samples)
    with torch.no_grad():
        features = module.classifier.trunk(of_all(samples))
    assert torch.allclose(features.mean(dim=0), torch.zeros(SIZES.feature), atol=1e-4)
    assert torch.allclose(features.std(dim=0), torch.ones(SIZES.feature), atol=1e-4)


def test_a_frozen_encoder_looks_at_every_sample_a_few_times_and_never_again(checkpoints, samples):
    settings = config(checkpoints["poe"], "frozen")
    module = pretrained.module_of(settings)
    data = CenteringData(samples, samples, settings)
    looks = []

    def trunk(batch):
        looks.append(len(batch["image"]))
        return module.classifier.trunk(batch)

    data.encode(trunk)
    assert sum(looks) == (VIEWS + 1) * len(samples)
    batches = [*data.train_dataloader(), *data.train_dataloader(), *data.val_dataloader()[0]]
    assert sum(looks) == (VIEWS + 1) * len(samples)
    assert {name for batch in batches for name in batch} == {"feature", "direction", "offset"}
    served = data.train_set[[3] * 50]["feature"]
    assert 1 < len(served.unique(dim=0)) <= VIEWS
    with torch.no_grad():
        assert torch.allclose(
            data.held_out[0][[3, 5]]["feature"], module.classifier.trunk(of_all(samples))[[3, 5]], atol=1e-5
        )


@pytest.mark.parametrize("use", ["frozen", "fine-tuned"])
def test_the_same_configuration_gives_the_same_run(use, checkpoints, tmp_path):
    first, second = (
        train_centering(config(checkpoints["poe"], use), tmp_path / name, console=QUIET) for name in ("a", "b")
    )
    assert replace(first, seconds=0) == replace(second, seconds=0)
    weights = [load_trained(tmp_path / name / "checkpoint.ckpt").state_dict() for name in ("a", "b")]
    assert all(torch.equal(value, weights[1][name]) for name, value in weights[0].items())


def test_training_and_test_samples_are_those_of_the_other_networks(checkpoints, tmp_path):
    latent = config(checkpoints["poe"], "frozen")
    own = TrainingConfig("drawn", "f", train_samples=8, test_samples=12, epochs=1, preset="tiny")
    results = [train_centering(one, tmp_path / one.encoder, "separate_test", QUIET) for one in (latent, own)]
    assert results[0].train_samples == results[1].train_samples
    columns = [
        [line.split(",")[:3] for line in (tmp_path / name / "predictions.csv").read_text().splitlines()]
        for name in ("vfp", "f")
    ]
    assert columns[0] == columns[1]


def test_what_was_trained_opens_without_the_pretraining(samples, tmp_path):
    checkpoint = write_latent(tmp_path / "latent.ckpt", "vtt")
    settings = config(checkpoint)
    train_centering(settings, tmp_path / "run", console=QUIET)
    checkpoint.unlink()
    module = load_trained(tmp_path / "run" / "checkpoint.ckpt")
    assert configuration(module) == settings == TrainingConfig(**json.loads(json.dumps(settings.plain())))
    predicted = [
        int(line.split(",")[3]) for line in (tmp_path / "run" / "predictions.csv").read_text().splitlines()[1:]
    ]
    episodes = [int(line.split(",")[1]) for line in (tmp_path / "run" / "predictions.csv").read_text().splitlines()[1:]]
    with torch.no_grad():
        again = module(of_all(samples.take(np.array(episodes)))).argmax(dim=1)
    assert again.tolist() == predicted
    page = (tmp_path / "run" / "report.md").read_text()
    assert "V+F+P VTT fine-tuned, 8 training samples" in page
    assert f"pretrained {STEPS} steps on data/picking, preset svfl_2023; it goes on learning" in page


def test_samples_are_observations_as_the_pretraining_saw_them(tmp_path):
    folder = written(tmp_path / "picking", [lifting(index) for index in range(2)])
    samples = load_centering(folder)
    for index, seen in enumerate(load_recordings(Dataset.open(folder), contact_n=0.5)):
        color, depth = seen.color[-1].transpose(2, 0, 1).astype(np.float32) / 255, seen.depth[-1]
        np.testing.assert_array_equal(samples.image[index], np.concatenate([color, depth[None]]))
        np.testing.assert_array_equal(samples.wrench[index], seen.wrench[-1])
        np.testing.assert_array_equal(samples.proprio[index], seen.proprio[-1])


def test_a_newer_checkpoint_is_another_one(tmp_path):
    planned = config(write_latent(tmp_path / "latent.ckpt"))
    write_latent(tmp_path / "latent.ckpt", seed=1)
    newer = config(tmp_path / "latent.ckpt")
    assert planned != newer
    assert str(planned.latent) != str(newer.latent)
    with pytest.raises(TrainingError, match=r"latent\.ckpt .*changed"):
        pretrained.module_of(planned)


def test_configurations_without_latents_are_written_as_before():
    assert "latent" not in TrainingConfig("data").plain()


def test_a_latent_encoder_has_its_own_sizes():
    network = {"model": "poe", "sizes": plain(SIZES)}
    fits = {"encoder": "vfp", "group": "none"}
    for change, facts in [
        ({"image_size": 32}, "image size .*32.* 64"),
        ({"window": 32}, "window .*32.* 64"),
        ({"group": "D4"}, "group .*'D4'.* none"),
        ({"encoder": "vf"}, "encoder .*'vf'.* vfp"),
        ({"latent_network": network | {"model": "mae"}}, "model 'mae'"),
    ]:
        with pytest.raises(TrainingError, match=facts):
            CenteringClassifier(**{"latent_network": network} | fits | change)
    with pytest.raises(TrainingError, match="exported"):
        inputs(CenteringClassifier(latent_network=network, **fits))


def command(*arguments):
    return cli.main(["centering", "--data", "drawn", *map(str, arguments)])


def test_a_whole_run(checkpoints, tmp_path, capsys):
    few = ("--train-samples", 8, "--test-samples", 8, "--epochs", 1)
    assert command("--latent", checkpoints["poe"], "--use", "frozen", *few, "--out", tmp_path / "run") == 0
    assert "V+F+P PoE frozen, 8 training samples: test accuracy" in capsys.readouterr().out
    settings = run_folder.read_config(tmp_path / "run")
    assert settings["latent"]["sha256"] == pretrained.digest(checkpoints["poe"])
    assert settings["augment"] is False


@pytest.mark.parametrize(
    ("arguments", "option"),
    [
        (["--encoder", "vf"], "--encoder"),
        (["--model", "cnn"], "--model"),
        (["--image-size", "32"], "--image-size"),
    ],
)
def test_options_that_contradict_it(arguments, option, checkpoints, capsys):
    assert command("--latent", checkpoints["poe"], *arguments) == 2
    error = capsys.readouterr().err
    assert "--latent" in error
    assert option in error
    assert command("--use", "frozen") == 2
    assert "--latent" in capsys.readouterr().err


def test_a_checkpoint_of_another_kind_is_one_line(samples, tmp_path, capsys):
    other = write(untrained(samples)[0], tmp_path / "centering.ckpt")
    assert command("--latent", other, "--out", tmp_path / "run") == 1
    error = capsys.readouterr().err
    assert re.search("svfl-centering.* svfl-latent", error)
    assert error.count("\n") == 1
    assert command("--latent", tmp_path / "nowhere.ckpt", "--out", tmp_path / "run") == 1
    assert "nowhere.ckpt" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()
