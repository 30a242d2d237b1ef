"""A block-centering training that is interrupted and resumed gives the result of an uninterrupted one, bit for bit."""

import json
import shutil
from dataclasses import replace

import pytest
import torch
from rich.console import Console

from svfl_data.errors import FormatError
from svfl_models.centering import pretrained, train
from svfl_models.centering.config import TrainingConfig
from svfl_models.centering.train import train_centering
from svfl_models.experiments.runs.training import Training
from svfl_models.training import run_folder
from svfl_models.training.progress import MetricsFile
from tests.helpers.pretrained import write_latent

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("drawn")]

QUIET = Console(quiet=True)
SMALL = TrainingConfig(
    "drawn", preset="tiny", image_size=8, train_samples=8, test_samples=12, epochs=12, batch_size=5, rotate=True
)


@pytest.fixture(scope="module")
def latent(tmp_path_factory):
    return write_latent(tmp_path_factory.mktemp("latent") / "latent.ckpt")


def on_latent(checkpoint, use):
    few = {"train_samples": 8, "test_samples": 12, "epochs": 3, "batch_size": 5}
    return TrainingConfig("drawn", **few | pretrained.settings(pretrained.describe(checkpoint, use)))


def interrupt(config, out, monkeypatch, epoch):
    """Press Ctrl-C in the middle of an epoch."""

    def stop(self, trainer, *rest):
        if trainer.current_epoch == epoch:
            raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(MetricsFile, "on_train_batch_end", stop)
        with pytest.raises(KeyboardInterrupt):
            train_centering(config, out, console=QUIET)
    assert not (out / run_folder.RESULT).exists()
    torch.rand(17)


def outcome(out):
    """Everything that a training leaves but times and its provenance."""
    found = torch.load(out / run_folder.CHECKPOINT, weights_only=True)
    rows = [line.split(",")[:-1] for line in (out / run_folder.METRICS).read_text().splitlines()]
    result = json.loads((out / run_folder.RESULT).read_text())
    del result["result"]["seconds"]
    kept = {name: state for name, state in found["callbacks"].items() if "Stopping" in name}
    return (
        {"weights": found["state_dict"], "adam": found["optimizer_states"], **found["CenteringData"]},
        (rows, result, str(kept), (out / run_folder.PREDICTIONS).read_text()),
    )


def assert_same(one, other):
    (states, texts), (other_states, other_texts) = outcome(one), outcome(other)
    torch.testing.assert_close(other_states, states, rtol=0, atol=0)
    assert other_texts == texts


@pytest.mark.parametrize("epoch", [0, 1, 10, 11])
def test_an_interruption_leaves_no_trace(epoch, tmp_path, monkeypatch):
    """Before, at and after the test in the tenth epoch, whatever was random in between."""
    train_centering(SMALL, tmp_path / "whole", console=QUIET)
    interrupt(SMALL, tmp_path / "cut", monkeypatch, epoch)
    train_centering(SMALL, tmp_path / "cut", console=QUIET)
    assert_same(tmp_path / "whole", tmp_path / "cut")


def test_a_training_may_be_interrupted_again_and_again(tmp_path, monkeypatch):
    train_centering(SMALL, tmp_path / "whole", console=QUIET)
    for epoch in (2, 5, 5, 9):
        interrupt(SMALL, tmp_path / "cut", monkeypatch, epoch)
    train_centering(SMALL, tmp_path / "cut", console=QUIET)
    assert_same(tmp_path / "whole", tmp_path / "cut")
    assert len(json.loads((tmp_path / "cut" / run_folder.PROVENANCE).read_text())["sessions"]) == 5


@pytest.mark.parametrize("valid_samples", [0, 4])
def test_patience_is_not_restored(valid_samples, tmp_path, monkeypatch):
    """A rate of nearly zero: the accuracy of the first epoch is the best one, and a new rule would wait longer."""
    config = replace(SMALL, epochs=30, patience=4, valid_samples=valid_samples, learning_rate=1e-12)
    assert train_centering(config, tmp_path / "whole", console=QUIET).epochs == 5
    interrupt(config, tmp_path / "cut", monkeypatch, 3)
    train_centering(config, tmp_path / "cut", console=QUIET)
    assert_same(tmp_path / "whole", tmp_path / "cut")


@pytest.mark.parametrize("patience", [0, 4])
def test_a_training_that_was_over_is_tested_only(patience, tmp_path, monkeypatch):
    """Interrupted after its last epoch, be it the last possible one or the one in which the rule stopped it."""
    config = replace(SMALL, epochs=30 if patience else 3, patience=patience, learning_rate=1e-12)
    train_centering(config, tmp_path / "whole", console=QUIET)
    with monkeypatch.context() as patched:
        patched.setattr(train, "evaluate", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
        with pytest.raises(KeyboardInterrupt):
            train_centering(config, tmp_path / "cut", console=QUIET)
    train_centering(config, tmp_path / "cut", console=QUIET)
    assert_same(tmp_path / "whole", tmp_path / "cut")


@pytest.mark.parametrize("use", ["frozen", "fine-tuned"])
def test_a_pretrained_encoder(use, latent, tmp_path, monkeypatch):
    config = on_latent(latent, use)
    train_centering(config, tmp_path / "whole", console=QUIET)
    interrupt(config, tmp_path / "cut", monkeypatch, 1)
    train_centering(config, tmp_path / "cut", console=QUIET)
    assert_same(tmp_path / "whole", tmp_path / "cut")


def test_a_finished_training_begins_anew(tmp_path):
    train_centering(SMALL, tmp_path / "run", console=QUIET)
    sessions = tmp_path / "run" / run_folder.PROVENANCE
    train_centering(SMALL, tmp_path / "run", console=QUIET)
    assert len(json.loads(sessions.read_text())["sessions"]) == 1


def test_settings_beside_the_configuration_are_those_of_the_last_command(tmp_path, monkeypatch):
    interrupt(SMALL, tmp_path / "run", monkeypatch, 1)
    result = train_centering(SMALL, tmp_path / "run", "separate", QUIET)
    assert result.separate_test_accuracy is not None
    assert run_folder.read_config(tmp_path / "run")["separate_test"] == "separate"


def test_a_damaged_checkpoint_is_one_line(tmp_path, monkeypatch):
    interrupt(SMALL, tmp_path / "run", monkeypatch, 1)
    (tmp_path / "run" / run_folder.CHECKPOINT).write_text("half a file")
    with pytest.raises(FormatError, match=r"checkpoint\.ckpt"):
        train_centering(SMALL, tmp_path / "run", console=QUIET)


@pytest.mark.parametrize("state", [None, "text", torch.zeros(3), torch.zeros(5056, dtype=torch.uint8)])
def test_a_checkpoint_without_random_numbers_is_one_line(state, tmp_path, monkeypatch):
    interrupt(SMALL, tmp_path / "run", monkeypatch, 1)
    checkpoint = tmp_path / "run" / run_folder.CHECKPOINT
    torch.save(torch.load(checkpoint, weights_only=True) | {"CenteringData": {"random": state}}, checkpoint)
    with pytest.raises(FormatError, match="no random numbers"):
        train_centering(SMALL, tmp_path / "run", console=QUIET)


def test_a_run_of_an_experiment_continues(tmp_path, monkeypatch):
    train_centering(SMALL, tmp_path / "whole", console=QUIET)
    interrupt(SMALL, tmp_path / "cut", monkeypatch, 5)
    began = []
    monkeypatch.setattr(
        MetricsFile, "on_train_epoch_start", lambda self, trainer, *_: began.append(trainer.current_epoch)
    )
    Training(SMALL, tmp_path / "cut")()
    assert began[0] == 5
    assert_same(tmp_path / "whole", tmp_path / "cut")


def test_a_run_of_an_experiment_does_not_continue_another_one(tmp_path, monkeypatch):
    interrupt(replace(SMALL, seed=1), tmp_path / "run", monkeypatch, 1)
    shutil.copytree(tmp_path / "run", tmp_path / "strange")
    (tmp_path / "strange" / run_folder.CONFIG).write_text("- of nobody")
    for name in ("run", "strange"):
        Training(SMALL, tmp_path / name)()
        assert len((tmp_path / name / run_folder.METRICS).read_text().splitlines()) == 1 + SMALL.epochs
