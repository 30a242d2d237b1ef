"""What is wrong with a file is said in one line, before anything is done with it."""

import re

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from svfl_data.errors import FormatError, TrainingError
from svfl_models.centering.checkpoint import configuration, load_classifier
from svfl_models.centering.config import TrainingConfig
from svfl_models.centering.data import CenteringData
from svfl_models.centering.module import CenteringModule
from tests.helpers.trained import contents, untrained, write


@pytest.fixture(scope="module")
def trained(samples):
    return untrained(samples)


@pytest.fixture(scope="module")
def file(trained, tmp_path_factory):
    return write(trained[0], tmp_path_factory.mktemp("run") / "checkpoint.ckpt")


def refusal(path):
    with pytest.raises(FormatError) as refused:
        load_classifier(path)
    assert str(path) in str(refused.value)
    assert "\n" not in str(refused.value)
    return str(refused.value)


def test_the_same_network_comes_back(trained, file, batch):
    module, config = trained
    loaded = load_classifier(file)
    assert torch.equal(loaded(batch), module(batch))
    assert not loaded.training
    assert configuration(loaded) == config
    assert configuration(loaded, "elsewhere").data == "elsewhere"


def test_a_network_without_a_recipe_has_the_usual_one():
    assert configuration(CenteringModule({"encoder": "f", "preset": "tiny"})) == TrainingConfig(
        data="", encoder="f", preset="tiny"
    )


def test_missing(tmp_path):
    refusal(tmp_path / "nowhere.ckpt")


def test_a_text(tmp_path):
    path = tmp_path / "notes.ckpt"
    path.write_text("not a network")
    refusal(path)


@settings(max_examples=20, deadline=None)
@given(share=st.floats(0, 1, exclude_max=True))
def test_cut_off(file, tmp_path_factory, share):
    whole = file.read_bytes()
    path = tmp_path_factory.mktemp("cut") / "checkpoint.ckpt"
    path.write_bytes(whole[: int(share * len(whole))])
    assert "cut off" in refusal(path)


@pytest.mark.parametrize(
    ("found", "facts"),
    [
        ({"weights": torch.zeros(2)}, "svfl-centering"),
        ([1, 2], "svfl-centering"),
        ({"svfl": {"format": "svfl-policy", "format_version": "1.0"}}, "svfl-policy.* svfl-centering"),
        ({"svfl": {"format": "svfl-centering", "format_version": "2.0"}}, r" 2\.0\b.* 1\."),
        ({"svfl": {"format": "svfl-centering", "format_version": "1.9"}}, "do not fit"),  # nothing else is in it
        (np.zeros, "not readable"),  # code, which is never run
    ],
)
def test_of_something_else(tmp_path, found, facts):
    torch.save(found, tmp_path / "other.ckpt")
    assert re.search(facts, refusal(tmp_path / "other.ckpt"))


@pytest.mark.parametrize(
    "change",
    [
        {"group": "C4"},
        pytest.param({"group": "D8"}, marks=pytest.mark.slow),
        {"group": "none"},
        {"window": 32},
        {"encoder": "v"},
        {"group": "E8"},
    ],
)
def test_weights_of_another_network(trained, tmp_path, change):
    found = contents(trained[0])
    network = found["hyper_parameters"]["network"] | change
    torch.save(found | {"hyper_parameters": found["hyper_parameters"] | {"network": network}}, tmp_path / "mixed.ckpt")
    assert "do not fit" in refusal(tmp_path / "mixed.ckpt")


def test_weights_that_are_missing(trained, tmp_path):
    found = contents(trained[0])
    found["state_dict"] = dict(list(found["state_dict"].items())[:-1])
    torch.save(found, tmp_path / "less.ckpt")
    assert "do not fit" in refusal(tmp_path / "less.ckpt")


@pytest.mark.parametrize(
    ("name", "shape"),
    [("wrench", (2, 32, 6)), ("wrench", (2, 64, 3)), ("image", (2, 4, 32, 32)), ("image", (2, 3, 64, 64))],
)
def test_inputs_that_the_network_was_not_built_for(trained, batch, name, shape):
    two = {key: values[:2] for key, values in batch.items()}
    with pytest.raises(TrainingError, match=rf"'{name}' .*\({', '.join(map(str, shape))}\)"):
        trained[0](two | {name: torch.zeros(shape)})
    with pytest.raises(TrainingError, match=f"no '{name}'"):
        trained[0]({key: values for key, values in two.items() if key != name})


@pytest.mark.parametrize("name", ["image", "wrench"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_nan_in_a_dataset_is_refused_before_the_training(samples, name, value):
    bad = samples.take(np.arange(8))
    getattr(bad, name)[3].flat[5] = value
    with pytest.raises(TrainingError, match=f"{name} .*episode 3 .*NaN or infinity"):
        CenteringData(bad, samples, TrainingConfig(data="nowhere"))


def test_nan_in_a_batch_never_reaches_the_weights(trained, batch):
    module, _ = trained
    batch = batch | {"wrench": torch.full_like(batch["wrench"], torch.nan), "direction": torch.zeros(8).long()}
    with pytest.raises(TrainingError, match=r"wrench .*epoch 0 .*NaN"):
        module.training_step(batch, 0)
