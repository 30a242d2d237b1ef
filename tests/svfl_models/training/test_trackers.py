"""What a training logs to a tracker is read back from the tracker's own files."""

import csv
import io
import json
import os
import re
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from rich.console import Console

from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import TrainingError, UsageError
from svfl_data.storage.store import write_episode
from svfl_models.centering.config import TrainingConfig
from svfl_models.centering.train import train_centering
from svfl_models.cloning.config import CloningConfig
from svfl_models.cloning.train import train_cloning
from svfl_models.latent import config as presets
from svfl_models.latent.config import LatentConfig
from svfl_models.latent.train import train_latent
from svfl_models.training import run_folder, trainer
from svfl_models.training.progress import MetricsFile
from svfl_models.training.trackers import names, trackers
from tests.helpers.builders import make_episode
from tests.helpers.demonstrations import demonstrations
from tests.helpers.latent_small import SIZES, lifting, written
from tests.helpers.tracker_files import mlflow_runs, tensorboard_numbers, wandb_runs

QUIET = Console(quiet=True)
INSTALLED = [name for name in names.TRACKERS if find_spec(name)]
MEASURED = {"learning_rate", "gradient_norm", "batch_loss", "seconds_per_step"}


@pytest.fixture
def own_environment(monkeypatch):
    """Settings of the one who runs the tests do not send anything anywhere."""
    for name in [name for name in os.environ if name.startswith(("WANDB_", "MLFLOW_"))]:
        monkeypatch.delenv(name)
    monkeypatch.setenv("WANDB_MODE", "offline")
    monkeypatch.setenv("MLFLOW_ALLOW_FILE_STORE", "true")


@pytest.fixture(scope="module")
def cloning(tmp_path_factory):
    folder = demonstrations(tmp_path_factory.mktemp("data") / "picking")
    return CloningConfig(str(folder), 6, "p", preset="tiny", valid=1 / 3, epochs=2, batch_size=10)


def logged(tracker, out):
    """Numbers of a tracker's only run."""
    if tracker == "tensorboard":
        return tensorboard_numbers(out)[0]
    ((*_, series, _, _),) = mlflow_runs(out) if tracker == "mlflow" else [(*wandb_runs(out)[0], None)]
    return series


def need(tracker):
    if tracker not in INSTALLED:
        pytest.skip(f"{tracker} is not installed")


@pytest.mark.slow
@pytest.mark.parametrize("tracker", names.TRACKERS)
def test_a_tracker_holds_what_the_csv_file_holds_and_measurements(tracker, cloning, tmp_path, own_environment):
    need(tracker)
    train_cloning(cloning, tmp_path, QUIET, loggers=[tracker])
    rows = list(csv.DictReader((tmp_path / run_folder.METRICS).open()))
    series = logged(tracker, tmp_path)
    for name in rows[0].keys() - {"seconds"}:
        assert [step for step, _ in series[name]] == [3, 6]  # three batches per epoch
        assert [value for _, value in series[name]] == pytest.approx([float(row[name]) for row in rows], rel=1e-4), name
    for name in MEASURED:
        assert [step for step, _ in series[name]] == [1, 3, 6]  # the first step, and the last of each epoch
    assert all(value > 0 for _, value in series["gradient_norm"])
    rates = [value for _, value in series["learning_rate"]]
    assert cloning.learning_rate > rates[0] > rates[1] > rates[2] == pytest.approx(0, abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("tracker", names.TRACKERS)
def test_a_training_that_is_resumed_goes_on_in_its_run(tracker, cloning, tmp_path, own_environment, monkeypatch):
    need(tracker)

    def interrupted(self, trainer, *_):
        if trainer.current_epoch == 1:
            raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(MetricsFile, "on_train_batch_end", interrupted)
        with pytest.raises(KeyboardInterrupt):
            train_cloning(cloning, tmp_path, QUIET, loggers=[tracker])
    train_cloning(cloning, tmp_path, QUIET, loggers=[tracker])
    if tracker == "wandb":
        first, second = wandb_runs(tmp_path)
        assert first[0] == second[0]
        epochs = first[2]["epoch"] + second[2]["epoch"]
    else:
        epochs = logged(tracker, tmp_path)["epoch"]
    assert epochs == [(3, 0), (6, 1)]


@pytest.mark.slow
def test_a_confusion_matrix_is_logged_as_the_picture_it_is(tmp_path, own_environment):
    need("tensorboard")
    folder = tmp_path / "centering"
    Dataset.create_or_resume(folder, "centering", seed=0, config={})
    for index in range(8):
        episode = make_episode(index, steps=3, size=76, angle=index % 4 * np.pi / 2 + 0.1)
        write_episode(episode, folder / f"episode_{index:06d}.hdf5")
    config = TrainingConfig(str(folder), "f", preset="tiny", train_samples=4, test_samples=4, epochs=1)
    for _ in range(2):  # the second training replaces the first
        train_centering(config, tmp_path / "run", console=QUIET, loggers=INSTALLED)
    assert tensorboard_numbers(tmp_path / "run")[1] == {
        "confusion_matrix": [(tmp_path / "run" / run_folder.CONFUSION).read_bytes()]
    }
    if "mlflow" in INSTALLED:
        for parameters, _, pictures, status in mlflow_runs(tmp_path / "run"):
            assert (parameters["encoder"], parameters["train_samples"]) == ("f", "4")
            assert (pictures, status) == ([f"pictures/{run_folder.CONFUSION}"], "FINISHED")
    if "wandb" in INSTALLED:
        for _, settings, _, media in wandb_runs(tmp_path / "run"):
            assert settings["encoder"] == "f"
            assert media["confusion_matrix"].is_file()


@pytest.mark.slow
def test_reconstructions_are_logged_and_steps_go_on(tmp_path, own_environment, monkeypatch):
    need("tensorboard")
    name = "svfl_2023"
    monkeypatch.setitem(presets.PRESETS, name, replace(presets.PRESETS[name], sizes=SIZES))
    folder = written(tmp_path / "data", [lifting(index) for index in range(5)])
    config = LatentConfig(str(folder), "poe", steps=2, batch_size=4, sequence=3, checkpoint_every=1)
    train_latent(config, tmp_path / "run", console=QUIET, loggers=["tensorboard"])
    train_latent(replace(config, steps=3), tmp_path / "run", console=QUIET, loggers=["tensorboard"])
    numbers, pictures = tensorboard_numbers(tmp_path / "run")
    assert [step for step, _ in numbers["valid_loss"]] == [1, 2, 3]
    assert [step for step, _ in numbers["gradient_norm"]] == [1, 2, 3]
    assert pictures["reconstructions"][-1] == (tmp_path / "run" / run_folder.RECONSTRUCTIONS).read_bytes()


@pytest.mark.slow
def test_without_a_tracker_nothing_is_measured(cloning, tmp_path, monkeypatch):
    """A step of an untracked training is not slower."""
    monkeypatch.setattr(trainer, "Measurements", None)
    train_cloning(cloning, tmp_path, QUIET)


class Broken:
    """A tracker whose server is gone after the first row."""

    def __init__(self, out, go_on):
        self.left = 1

    def configuration(self, values):
        json.dumps(values)

    def numbers(self, values, step):
        self.left -= 1
        if self.left < 0:
            raise ConnectionError("no route\nto host")

    def picture(self, name, file):
        raise AssertionError("it is left out after its first failure")

    close = picture


@pytest.mark.slow
def test_a_tracker_that_fails_ends_no_training(cloning, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(trackers, "_opened", lambda name, out, go_on: Broken(out, go_on))
    monkeypatch.setattr(trackers, "check_trackers", lambda names: None)
    monkeypatch.setattr("svfl_models.cloning.train.check_trackers", lambda names: None)
    result = train_cloning(cloning, tmp_path, QUIET, loggers=["far away"])
    assert result.epochs == 2
    assert capsys.readouterr().err == "tracker far away failed, nothing more is logged to it: no route to host\n"


def test_a_tracker_that_cannot_be_opened_is_one_line(tmp_path, monkeypatch):
    monkeypatch.setattr(trackers, "check_trackers", lambda names: None)
    monkeypatch.setitem(trackers.MODULES, "far", ("tracker", "Nothing"))
    with (
        pytest.raises(TrainingError, match=r"^--logger far: cannot be opened below .*Nothing"),
        trackers.opened(["far"], tmp_path),
    ):
        pass


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        (["neptune"], "--logger neptune: no such tracker; possible: tensorboard, wandb, mlflow"),
        (["wandb"], "--logger wandb needs wandb, which is not installed; run: pip install 'svfl[wandb]'"),
        (["mlflow", "tensorboard", "mlflow"], "--logger mlflow is given twice"),
    ],
)
def test_what_cannot_be_logged_to_is_one_line_before_anything_begins(asked, words, tmp_path, monkeypatch):
    monkeypatch.setattr(names, "_installed", lambda library: library != "wandb")
    with pytest.raises(UsageError, match=f"^{re.escape(words)}$") as raised:
        train_cloning(CloningConfig(str(tmp_path / "none")), tmp_path / "out", QUIET, loggers=asked)
    assert raised.value.exit_code == 2
    assert not (tmp_path / "out").exists()


def test_a_film_is_logged_as_a_video(tmp_path, own_environment):
    """Two frames that differ, of which trackers get the file."""
    need("tensorboard")
    frames = [Image.fromarray(np.full((8, 8, 3), value, np.uint8)) for value in (0, 255)]
    file: Path = tmp_path / "rollout.gif"
    frames[0].save(file, save_all=True, append_images=frames[1:])
    with trackers.opened(INSTALLED, tmp_path) as opened:
        opened.picture("rollout", file)
    ((shown,),) = tensorboard_numbers(tmp_path)[1].values()
    assert Image.open(io.BytesIO(shown)).n_frames == 2
    if "wandb" in INSTALLED:
        assert wandb_runs(tmp_path)[0][3]["rollout"].read_bytes() == file.read_bytes()
