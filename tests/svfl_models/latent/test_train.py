import dataclasses
import json
import math

import pytest
import torch
from rich.console import Console

from svfl_data.errors import FormatError, StorageError, TrainingError
from svfl_models.cli import main
from svfl_models.latent import config as presets
from svfl_models.latent import module as latent_module
from svfl_models.latent import train
from svfl_models.latent.checkpoint import load_latent
from svfl_models.latent.config import MODELS, TERMS, LatentConfig
from svfl_models.latent.progress import StepsBar
from svfl_models.training import run_folder
from svfl_models.training.writing import read_numbers
from tests.helpers.latent_small import SIZES, frames, lifting, written

pytestmark = pytest.mark.slow


@pytest.fixture(autouse=True)
def narrow(monkeypatch):
    for name, preset in presets.PRESETS.items():
        monkeypatch.setitem(presets.PRESETS, name, dataclasses.replace(preset, sizes=SIZES))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return written(tmp_path_factory.mktemp("data") / "picking", [lifting(index) for index in range(5)])


@pytest.fixture
def config(folder):
    return LatentConfig(str(folder), "poe", steps=5, checkpoint_every=2, batch_size=4, sequence=3)


def named(config):
    """The configuration with the name of its camera, which a training finds out."""
    return config.plain() | {"camera": "front"}


def weights(out):
    return torch.load(out / run_folder.CHECKPOINT, weights_only=True)


def assert_same_training(one, other):
    for key, value in one["state_dict"].items():
        assert torch.equal(value, other["state_dict"][key]), key
    for number, state in one["optimizer_states"][0]["state"].items():
        for key, value in state.items():
            assert torch.equal(value, other["optimizer_states"][0]["state"][number][key])


@pytest.mark.parametrize("model", MODELS)
def test_every_model_trains_and_opens_again(model, config, tmp_path):
    config = dataclasses.replace(config, model=model)
    result = train.train_latent(config, tmp_path / "run")
    assert result.steps == 5
    assert json.loads((tmp_path / "run" / "result.json").read_text())["config"] == named(config)
    rows = read_numbers(tmp_path / "run" / "metrics.csv")
    assert [row["step"] for row in rows] == [2, 4, 5]
    for name in TERMS:
        known = model == "poe" or name != "expert_kl"
        assert (f"train_{name}" in rows[0]) == (f"valid_{name}_weighted" in rows[0]) == known
    weighted = sum(rows[0].get(f"train_{name}_weighted", 0.0) for name in TERMS)
    assert weighted == pytest.approx(rows[0]["train_loss"], rel=1e-4)

    said = (tmp_path / "run" / run_folder.REPORT).read_text()
    assert f"| **loss** | {result.last['train_loss']:.4g} | {result.last['valid_loss']:.4g} |" in said
    assert ("expert_kl" in said.split("| setting")[0]) == (model == "poe")
    assert (tmp_path / "run" / run_folder.LEARNING_CURVE).stat().st_size

    module = load_latent(tmp_path / "run" / "checkpoint.ckpt")
    assert module.hparams["training"] == named(config)
    assert set(module.hparams["split"]) == {"train", "valid"}
    assert module.network.inputs.normalization.scale("wrench")[2] != 1  # fitted, not the identity
    encoding = module.network.encode(frames())
    assert encoding.feature.shape == (3, SIZES.feature)


@pytest.mark.parametrize(("model", "schedule"), [("poe", "constant"), ("vtt", "constant"), ("poe", "cosine")])
def test_an_interrupted_training_resumes_bit_for_bit(model, schedule, config, tmp_path, monkeypatch):
    config = dataclasses.replace(config, model=model, schedule=schedule, steps=7)
    train.train_latent(config, tmp_path / "whole")

    def stop(self, trainer, pl_module, *_):
        if pl_module.steps == 5:  # in the middle of a leg
            raise KeyboardInterrupt

    with monkeypatch.context() as interrupted:
        interrupted.setattr(StepsBar, "on_train_batch_end", stop)
        with pytest.raises(KeyboardInterrupt):
            train.train_latent(config, tmp_path / "broken")
    assert weights(tmp_path / "broken")["svfl"]["steps"] == 4
    torch.manual_seed(99)  # whatever happened in between
    result = train.train_latent(config, tmp_path / "broken")
    assert result.steps == 7
    assert_same_training(weights(tmp_path / "whole"), weights(tmp_path / "broken"))
    without_time = [
        [{key: value for key, value in row.items() if key != "seconds"} for row in read_numbers(out / "metrics.csv")]
        for out in (tmp_path / "whole", tmp_path / "broken")
    ]
    assert without_time[0] == without_time[1]


def test_a_training_can_be_made_longer(config, tmp_path):
    train.train_latent(config, tmp_path / "long")
    train.train_latent(dataclasses.replace(config, steps=4), tmp_path / "short")
    train.train_latent(config, tmp_path / "short")
    assert_same_training(weights(tmp_path / "long"), weights(tmp_path / "short"))
    assert run_folder.is_same(run_folder.read_config(tmp_path / "short"), "latent", named(config))
    with pytest.raises(TrainingError, match=r"\b5 steps .*asked for 4\b"):
        train.train_latent(dataclasses.replace(config, steps=4), tmp_path / "short")


def rates(config, out, monkeypatch):
    """The learning rate of each step of a training."""
    found = []

    def note(self, trainer, *_):
        found.append(trainer.optimizers[0].param_groups[0]["lr"])

    with monkeypatch.context() as patched:
        patched.setattr(StepsBar, "on_train_batch_start", note)
        train.train_latent(config, out)
    return found


def test_the_learning_rate_takes_its_course_over_the_steps_that_are_asked_for(config, tmp_path, monkeypatch):
    assert rates(config, tmp_path / "constant", monkeypatch) == [1e-4] * 5
    falling = rates(dataclasses.replace(config, schedule="cosine"), tmp_path / "cosine", monkeypatch)
    assert falling == pytest.approx([1e-4 * (1 + math.cos(math.pi * step / 5)) / 2 for step in range(5)])


def test_a_training_whose_learning_rate_has_fallen_is_not_made_longer(config, tmp_path):
    config = dataclasses.replace(config, schedule="cosine", steps=2)
    train.train_latent(config, tmp_path / "run")
    before = weights(tmp_path / "run")
    with pytest.raises(TrainingError, match=r"steps = 2, now 4.*--out"):
        train.train_latent(dataclasses.replace(config, steps=4), tmp_path / "run")
    with pytest.raises(TrainingError, match=r"schedule = 'cosine', now 'constant'.*--out"):
        train.train_latent(dataclasses.replace(config, schedule="constant"), tmp_path / "run")
    assert_same_training(before, weights(tmp_path / "run"))


def test_a_finished_training_is_done_anew(config, tmp_path):
    config = dataclasses.replace(config, steps=1)
    train.train_latent(config, tmp_path / "run")
    before = weights(tmp_path / "run")
    (tmp_path / "run" / "metrics.csv").write_text("spoilt")
    train.train_latent(config, tmp_path / "run")
    assert_same_training(before, weights(tmp_path / "run"))
    assert len(read_numbers(tmp_path / "run" / "metrics.csv")) == 1


def test_seeds_make_other_trainings(config, tmp_path):
    for seed in (0, 1):
        train.train_latent(dataclasses.replace(config, seed=seed, steps=1), tmp_path / str(seed))
    with pytest.raises(AssertionError):
        assert_same_training(weights(tmp_path / "0"), weights(tmp_path / "1"))


def test_a_checkpoint_of_another_training_is_not_gone_on_from(config, tmp_path):
    train.train_latent(dataclasses.replace(config, steps=1), tmp_path / "run")
    other = dataclasses.replace(config, preset="lee_2020")
    with pytest.raises(TrainingError, match=r"preset = 'svfl_2023'.* 'lee_2020'"):
        train.train_latent(other, tmp_path / "run")


def test_only_checkpoints_of_this_kind_open(config, tmp_path, monkeypatch):
    train.train_latent(dataclasses.replace(config, steps=1), tmp_path / "run")
    path = tmp_path / "run" / "checkpoint.ckpt"
    content = weights(tmp_path / "run")
    torch.save(content | {"svfl": {"format": "svfl-centering", "format_version": "1.0"}}, tmp_path / "other.ckpt")
    with pytest.raises(FormatError, match=r"svfl-centering.* svfl-latent"):
        load_latent(tmp_path / "other.ckpt")
    torch.save(content | {"svfl": {"format": "svfl-latent", "format_version": "2.0"}}, tmp_path / "new.ckpt")
    with pytest.raises(FormatError, match=r" 2\.0\b.* 1\.0\b"):
        load_latent(tmp_path / "new.ckpt")
    torch.save(content | {"state_dict": {}}, tmp_path / "empty.ckpt")
    with pytest.raises(FormatError, match="do not fit"):
        load_latent(tmp_path / "empty.ckpt")
    (tmp_path / "cut.ckpt").write_bytes(path.read_bytes()[:500])
    with pytest.raises(FormatError, match=r"cut\.ckpt"):
        load_latent(tmp_path / "cut.ckpt")


def test_a_loss_that_is_not_finite_ends_the_training(config, tmp_path):
    with pytest.raises(TrainingError, match=r"loss .* \d+ steps .*learning rate .*1e\+30"):
        train.train_latent(dataclasses.replace(config, learning_rate=1e30, steps=20), tmp_path / "run")


def test_a_full_disk_is_one_line(config, tmp_path, monkeypatch):
    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(latent_module.LatentModule, "on_save_checkpoint", full)
    with pytest.raises(StorageError, match=r"run.* No space left on device"):
        train.train_latent(config, tmp_path / "run", console=Console(quiet=True))


def test_the_command(folder, tmp_path, capsys):
    common = ["latent", "--model", "concat", "--data", str(folder), "--out", str(tmp_path / "run")]
    assert main([*common, "--steps", "2", "--batch-size", "4", "--sequence", "3"]) == 0
    printed, told = capsys.readouterr()
    assert "concat, preset svfl_2023: " in told
    assert "step 2/2: loss " in told
    assert f"checkpoint  {tmp_path / 'run' / 'checkpoint.ckpt'}" in printed
    assert main([*common, "--steps", "3", "--batch-size", "4", "--sequence", "3"]) == 0
    assert "step 3/3: loss " in capsys.readouterr().err
    assert main(["latent", "--model", "poe", "--data", str(tmp_path / "no")]) == 1
    assert str(tmp_path / "no") in capsys.readouterr().err
