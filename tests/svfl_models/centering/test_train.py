import csv
import json
import signal
from dataclasses import replace
from pathlib import Path

import lightning.pytorch as pl
import numpy as np
import pytest
import torch
from rich.console import Console

from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import DatasetError, StorageError, TrainingError
from svfl_data.storage.store import write_episode
from svfl_models.centering import train
from svfl_models.centering.checkpoint import load_classifier
from svfl_models.centering.config import TrainingConfig
from svfl_models.centering.evaluate import evaluate
from svfl_models.centering.train import built, train_centering
from svfl_models.symmetry.testing import assert_equivariant
from svfl_models.training.progress import COLUMNS, MetricsFile, ProgressLine
from svfl_models.training.writing import read_numbers
from tests.helpers.builders import make_episode
from tests.helpers.synthetic import centering_samples

pytestmark = pytest.mark.slow

QUARTER = np.pi / 2


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    """Twenty-four episodes on disk whose wrench tells the direction; images are noise."""
    folder = tmp_path_factory.mktemp("data") / "centering"
    Dataset.create_or_resume(folder, "centering", seed=0, config={})
    for index in range(24):
        episode = make_episode(index, steps=3, size=76, angle=index % 4 * QUARTER + 0.1)
        write_episode(episode, folder / f"episode_{index:06d}.hdf5")
    return folder


@pytest.fixture
def config(dataset):
    return TrainingConfig(str(dataset), encoder="f", train_samples=8, test_samples=12, epochs=3)


def test_a_training_stops_by_samples_that_are_neither_learned_from_nor_tested(config, tmp_path):
    """Those do not change what is learned from, nor what is tested."""
    plain = train_centering(config, tmp_path / "plain")
    held = replace(config, train_samples=config.train_samples - 1, valid_samples=1, epochs=40, patience=2)
    stopped = train_centering(held, tmp_path / "stopped")
    assert stopped.epochs < 40
    rows = read_numbers(tmp_path / "stopped" / "metrics.csv")
    assert [row["valid_accuracy"] for row in rows].count(rows[-1]["valid_accuracy"]) >= 2
    assert "valid_accuracy" not in read_numbers(tmp_path / "plain" / "metrics.csv")[0]
    module, data = built(held)
    learned, _ = built(replace(held, valid_samples=0, patience=0))
    assert all(torch.equal(a, b) for a, b in zip(module.parameters(), learned.parameters(), strict=True))
    parts = [data.train_set, *data.held_out]
    assert [len(part) for part in parts] == [held.train_samples, held.test_samples, 1]
    assert sum(plain.train_samples) == config.train_samples


def test_a_run_leaves_everything_that_it_promises(config, tmp_path, batch):
    result = train_centering(config, tmp_path / "run")
    assert {file.name for file in (tmp_path / "run").iterdir()} == {
        "run.yaml", "checkpoint.ckpt", "metrics.csv", "predictions.csv", "learning_curve.png",
        "confusion_matrix.png", "report.md", "result.json", "provenance.json",
    }  # fmt: skip
    rows = list(csv.reader((tmp_path / "run" / "metrics.csv").open()))
    assert rows[0] == list(COLUMNS)
    assert [row[0] for row in rows[1:]] == ["0", "1", "2"]
    assert float(rows[-1][4]) == pytest.approx(result.test_accuracy, abs=1e-5)
    written = json.loads((tmp_path / "run" / "result.json").read_text())
    assert written["config"] == config.plain()
    assert written["result"]["test_accuracy"] == result.test_accuracy
    assert np.trace(result.confusion) / np.sum(result.confusion) == pytest.approx(result.test_accuracy)
    assert f"**{result.test_accuracy:.1%}**" in (tmp_path / "run" / "report.md").read_text()
    assert sum(result.train_samples) == 8

    module = load_classifier(tmp_path / "run" / "checkpoint.ckpt")
    assert module.hparams["training"] == config.plain()
    assert module.classifier.trunk.normalization.scale("wrench")[2] > 1  # fitted, not the identity
    assert_equivariant(module.classifier, {"wrench": batch["wrench"]})


def test_force_is_learned_from_ten_samples(monkeypatch, tmp_path):
    samples = centering_samples(110, seed=1)
    monkeypatch.setattr(train, "_load", lambda *_: samples)
    monkeypatch.setattr(train, "with_camera", lambda config: config)
    config = TrainingConfig("drawn", encoder="f", train_samples=10, epochs=40)
    assert train_centering(config, tmp_path / "svfl").test_accuracy > 0.9
    assert train_centering(replace(config, torque="polar"), tmp_path / "polar").test_accuracy < 0.8


def test_vision_and_force_learn_together(monkeypatch, tmp_path):
    samples = centering_samples(80, seed=1)
    monkeypatch.setattr(train, "_load", lambda *_: samples)
    monkeypatch.setattr(train, "with_camera", lambda config: config)
    config = TrainingConfig("drawn", train_samples=40, test_samples=40, epochs=20)
    result = train_centering(config, tmp_path / "run", separate_test="drawn too")
    assert result.test_accuracy > 0.8
    assert result.separate_test_accuracy > 0.8
    again = evaluate(load_classifier(tmp_path / "run" / "checkpoint.ckpt"), samples, config)
    assert again.accuracy == result.separate_test_accuracy
    rows = list(csv.DictReader((tmp_path / "run" / "predictions.csv").open()))
    assert [row["samples"] for row in rows] == ["test"] * 40 + ["separate_test"] * 80
    assert [int(row["predicted"]) for row in rows[40:]] == again.predicted.tolist()


def test_offsets_are_learned_in_metres(monkeypatch, tmp_path):
    samples = centering_samples(140, seed=1)
    monkeypatch.setattr(train, "_load", lambda *_: samples)
    monkeypatch.setattr(train, "with_camera", lambda config: config)
    config = TrainingConfig("drawn", encoder="f", target="offset", train_samples=40, epochs=60)
    result = train_centering(config, tmp_path / "run")
    assert result.test_accuracy > 0.9
    assert result.offset_error_mm < 15  # half their mean length; the drawn force hardly tells how long they are
    assert "mm off on average" in (tmp_path / "run" / "report.md").read_text()


def test_the_same_seed_gives_the_same_run(config, tmp_path):
    first, second = (train_centering(config, tmp_path / name) for name in ("a", "b"))
    assert replace(first, seconds=0) == replace(second, seconds=0)
    weights = [torch.load(tmp_path / name / "checkpoint.ckpt", weights_only=True)["state_dict"] for name in ("a", "b")]
    assert all(torch.equal(weights[0][key], weights[1][key]) for key in weights[0])
    other = replace(config, seed=1)
    train_centering(other, tmp_path / "c")
    third = torch.load(tmp_path / "c" / "checkpoint.ckpt", weights_only=True)["state_dict"]
    assert not torch.equal(third["classifier.head.weights"], weights[0]["classifier.head.weights"])


def test_the_papers_rule_stops_when_the_test_accuracy_stands_still(config, tmp_path):
    assert train_centering(replace(config, epochs=50, patience=2, learning_rate=1e-12), tmp_path / "run").epochs == 3


def test_a_folder_is_not_shared_between_configurations(config, tmp_path):
    train_centering(config, tmp_path / "run")
    with pytest.raises(TrainingError, match=r"seed = 0.* 1.* --out"):
        train_centering(replace(config, seed=1), tmp_path / "run")
    again = train_centering(config, tmp_path / "run")
    assert len((tmp_path / "run" / "metrics.csv").read_text().splitlines()) == 1 + again.epochs


def test_a_folder_with_foreign_files_is_left_alone(config, dataset, tmp_path):
    (tmp_path / "checkpoint.ckpt").write_text("mine")
    with pytest.raises(TrainingError, match=r"checkpoint\.ckpt"):
        train_centering(config, tmp_path)
    assert (tmp_path / "checkpoint.ckpt").read_text() == "mine"
    with pytest.raises(TrainingError, match=r"dataset\.json"):
        train_centering(config, dataset)


def test_more_samples_than_there_are(config, tmp_path):
    with pytest.raises(DatasetError, match=r"13 training .*12 test .*24"):
        train_centering(replace(config, train_samples=13), tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_a_row_that_the_disk_does_not_take_is_one_line(config, tmp_path, monkeypatch):
    """Files that are replaced: tests/test_full_disk.py; rows of the metrics are appended."""
    begin = MetricsFile.on_fit_start

    def begin_on_a_full_disk(metrics, *arguments):
        begin(metrics, *arguments)
        metrics.path = Path("/dev/full")

    monkeypatch.setattr(MetricsFile, "on_fit_start", begin_on_a_full_disk)
    with pytest.raises(StorageError, match="run: No space left on device"):
        train_centering(config, tmp_path / "run")


class Poison(pl.Callback):
    """Makes the weights useless after the second epoch."""

    def on_train_epoch_start(self, trainer, pl_module):
        if trainer.current_epoch == 2:
            with torch.no_grad():
                next(pl_module.parameters()).fill_(torch.nan)


def test_a_diverging_training_stops_and_keeps_the_last_good_checkpoint(config, tmp_path, monkeypatch):
    monkeypatch.setattr(train, "ProgressLine", lambda *arguments: Poison())
    with pytest.raises(TrainingError, match=r"train loss .*nan .*epoch 2"):
        train_centering(replace(config, epochs=5), tmp_path / "run")
    kept = torch.load(tmp_path / "run" / "checkpoint.ckpt", weights_only=True)
    assert kept["epoch"] == 1
    assert all(torch.isfinite(weight).all() for weight in kept["state_dict"].values())


class CtrlC(pl.Callback):
    """Presses Ctrl-C in the third epoch."""

    def on_train_epoch_start(self, trainer, pl_module):
        if trainer.current_epoch == 2:
            signal.raise_signal(signal.SIGINT)


def test_an_interrupted_training_keeps_its_epochs(config, tmp_path, monkeypatch):
    monkeypatch.setattr(train, "ProgressLine", lambda *arguments: CtrlC())
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt):
        train_centering(replace(config, epochs=5), tmp_path / "run")
    assert signal.getsignal(signal.SIGINT) == before
    assert torch.load(tmp_path / "run" / "checkpoint.ckpt", weights_only=True)["epoch"] == 1
    assert len((tmp_path / "run" / "metrics.csv").read_text().splitlines()) == 3


def test_progress_is_quiet_where_nobody_watches(config, tmp_path, capsys):
    train_centering(config, tmp_path / "run")
    assert capsys.readouterr() == ("", "")


def test_progress_tells_a_terminal(config, tmp_path):
    console = Console(force_terminal=True, record=True, width=100)
    train_centering(config, tmp_path / "run", console=console)
    assert "test accuracy" in console.export_text()


def test_a_long_training_prints_a_line_now_and_then(config, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("svfl_models.training.progress.QUIET_SECONDS", 0.0)
    train_centering(config, tmp_path / "run")
    lines = capsys.readouterr().err.splitlines()
    assert [line.split(":")[0] for line in lines] == ["epoch 1/3", "epoch 2/3", "epoch 3/3"]
    assert ProgressLine(3, Console()).best == 0
