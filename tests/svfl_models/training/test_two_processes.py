"""Trainings of our own networks in two processes: the result of one, resumed as well, and Ctrl-C ends both."""

import csv
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest
import torch
from rich.console import Console

from svfl_data.datasets.dataset import Dataset
from svfl_data.storage.store import write_episode
from svfl_models.centering.checkpoint import load_classifier
from svfl_models.centering.config import TrainingConfig
from svfl_models.centering.train import train_centering
from svfl_models.cloning.checkpoint import load_policy
from svfl_models.cloning.config import CloningConfig
from svfl_models.cloning.train import built, train_cloning
from svfl_models.latent.config import LatentConfig, plain
from svfl_models.latent.train import train_latent
from svfl_models.training import run_folder
from svfl_models.training.hardware import Hardware
from svfl_models.training.progress import MetricsFile
from svfl_models.training.writing import read_numbers
from tests.helpers.builders import make_episode
from tests.helpers.demonstrations import demonstrations
from tests.helpers.latent_small import SIZES, lifting, written
from tests.helpers.patience import PATIENCE

pytestmark = pytest.mark.slow

QUIET = Console(quiet=True)
ROUNDING = 1e-4
"""Largest relative difference of outputs. The two halves of a batch are summed in another order, which changes the
gradients by some 1e-6 of their size, and a few steps of Adam the weights by no more of the learning rate. An exception
are weights whose gradient is nothing but rounding: the bias of the keys of an attention, what adds the same number to
all four scores of a softmax. Adam makes whole steps of it, and no loss depends on it. So actions and probabilities are
compared, not weights."""
ONE, TWO = Hardware("cpu"), Hardware("cpu", devices=2)


@pytest.fixture(scope="module")
def cloning(tmp_path_factory):
    """Twenty-four steps in batches of nine and six."""
    folder = demonstrations(tmp_path_factory.mktemp("data") / "picking", size=10)
    return CloningConfig(
        str(folder), 6, preset="tiny", image_size=8, valid=1 / 3, epochs=2, batch_size=9, learning_rate=3e-3
    )


@pytest.fixture(scope="module")
def shared(cloning, tmp_path_factory):
    """A policy that two processes have trained."""
    out = tmp_path_factory.mktemp("shared")
    return train_cloning(cloning, out, QUIET, hardware=TWO), out


def rows(out):
    return list(csv.DictReader((out / run_folder.METRICS).open()))


def test_a_policy_is_that_of_one_process(cloning, shared, tmp_path):
    alone = train_cloning(cloning, tmp_path, QUIET, hardware=ONE)
    result, out = shared
    names = [name for name in vars(alone) if isinstance(getattr(alone, name), float) and name != "seconds"]
    assert [getattr(result, name) for name in names] == pytest.approx(
        [getattr(alone, name) for name in names], rel=1e-4
    )
    assert [row["epoch"] for row in rows(out)] == ["0", "1"]
    assert {file.name for file in out.iterdir()} == {file.name for file in tmp_path.iterdir()}
    batch = built(cloning)[1].valid_set.typical()
    with torch.no_grad():
        one, other = (load_policy(folder / run_folder.CHECKPOINT)(batch).mode for folder in (tmp_path, out))
    torch.testing.assert_close(one, other, rtol=ROUNDING, atol=ROUNDING * float(one.abs().max()))
    assert json.loads((out / run_folder.RESULT).read_text())["hardware"]["processes"] == 2


def test_an_interrupted_training_of_two_resumes(cloning, shared, tmp_path, monkeypatch):
    """The same processes give the same bits, interrupted or not; one process can go on with it too."""
    write = MetricsFile.on_train_epoch_end

    def interrupted(self, trainer, module):
        write(self, trainer, module)
        if trainer.current_epoch == 1:
            raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(MetricsFile, "on_train_epoch_end", interrupted)
        with pytest.raises(KeyboardInterrupt):
            train_cloning(cloning, tmp_path / "two", QUIET, hardware=TWO)
    shutil.copytree(tmp_path / "two", tmp_path / "alone")
    train_cloning(cloning, tmp_path / "two", QUIET, hardware=TWO)
    one, other = (
        torch.load(folder / run_folder.CHECKPOINT, weights_only=True)["state_dict"]
        for folder in (tmp_path / "two", shared[1])
    )
    assert all(torch.equal(one[name], other[name]) for name in other)
    assert [row["train_loss"] for row in rows(tmp_path / "two")] == [row["train_loss"] for row in rows(shared[1])]
    alone = train_cloning(cloning, tmp_path / "alone", QUIET, hardware=ONE)
    assert alone.valid_loss == pytest.approx(shared[0].valid_loss, rel=1e-4)


def test_a_classifier_is_that_of_one_process(tmp_path):
    """With random crops, colours and rotations, which both processes must draw alike, and the rule that stops."""
    folder = tmp_path / "centering"
    Dataset.create_or_resume(folder, "centering", seed=0, config={})
    for index in range(24):
        write_episode(
            make_episode(index, steps=3, size=76, angle=index % 4 * np.pi / 2 + 0.1),
            folder / f"episode_{index:06d}.hdf5",
        )
    config = TrainingConfig(
        str(folder), preset="tiny", image_size=16, train_samples=9, test_samples=11, epochs=20, batch_size=4,
        rotate=True, patience=2,
    )  # fmt: skip
    alone, two = (
        train_centering(config, tmp_path / name, console=QUIET, hardware=hardware)
        for name, hardware in (("alone", ONE), ("two", TWO))
    )
    assert alone.epochs < config.epochs
    assert replace(two, seconds=0) == replace(alone, seconds=0)
    batch = {"image": torch.rand(5, 4, 16, 16), "wrench": torch.randn(5, 64, 6)}
    with torch.no_grad():
        one, other = (
            load_classifier(tmp_path / name / run_folder.CHECKPOINT)(batch).softmax(dim=1) for name in ("alone", "two")
        )
    torch.testing.assert_close(one, other, rtol=0, atol=ROUNDING)


@pytest.mark.parametrize(("model", "preset"), [("vtt", "svfl_2023"), ("poe", "lee_2020")])
def test_a_latent_model_is_that_of_one_process(model, preset, tmp_path):
    """Processes draw the same latent states and mismatched pairs, of frames that another process may have.

    One preset has terms without weight, so that some parameters get no gradient. Two go on with what one has begun.
    """
    folder = written(tmp_path / "picking", [lifting(index) for index in range(5)])
    config = LatentConfig(
        str(folder), model, preset, steps=4, checkpoint_every=2, batch_size=5, sequence=3, sizes=plain(SIZES)
    )
    train_latent(config, tmp_path / "one", console=QUIET, hardware=ONE)
    train_latent(config, tmp_path / "two", console=QUIET, hardware=TWO)
    train_latent(replace(config, steps=2), tmp_path / "resumed", console=QUIET, hardware=ONE)
    train_latent(config, tmp_path / "resumed", console=QUIET, hardware=TWO)
    one, *others = (read_numbers(tmp_path / name / run_folder.METRICS) for name in ("one", "two", "resumed"))
    for other in others:
        for row, expected in zip(other, one, strict=True):
            assert {**row, "seconds": 0} == pytest.approx({**expected, "seconds": 0}, rel=1e-4, abs=1e-6)
    weights = [
        torch.load(tmp_path / name / run_folder.CHECKPOINT, weights_only=True)["state_dict"] for name in ("one", "two")
    ]
    for key, value in weights[0].items():
        torch.testing.assert_close(weights[1][key], value, rtol=1e-4, atol=2 * config.steps * config.learning_rate)


INTERRUPTED = """
import sys
from pathlib import Path
from svfl_data.system.command_line import run
from svfl_models.cloning.config import CloningConfig
from svfl_models.cloning.train import train_cloning
from svfl_models.training.hardware import Hardware
config = CloningConfig(sys.argv[1], 6, "p", preset="tiny", valid=1 / 3, epochs=100_000)
sys.exit(run(lambda: train_cloning(config, Path(sys.argv[2]), hardware=Hardware("cpu", devices=2)), "svfl-train"))
"""


def is_there(group):
    """Whether any process of a group is alive."""
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_both(number, cloning, tmp_path):
    """Ctrl-C is sent to all processes of a terminal's job, SIGTERM to the first process alone."""
    command = [sys.executable, "-c", INTERRUPTED, cloning.data, str(tmp_path / "out")]
    first = subprocess.Popen(command, start_new_session=True, stderr=subprocess.PIPE, text=True)
    try:
        end = time.monotonic() + PATIENCE
        while not (tmp_path / "out" / run_folder.CHECKPOINT).exists():
            assert first.poll() is None, first.stderr.read()
            assert time.monotonic() < end
            time.sleep(0.1)
        (os.killpg if number == signal.SIGINT else os.kill)(first.pid, number)
        _, errors = first.communicate(timeout=PATIENCE)
        assert first.returncode == 128 + number, errors
        assert errors == "svfl-train: interrupted; everything finished so far is on disk\n"
        while is_there(first.pid):  # multiprocessing's own helper ends a little after the process that it helped
            assert time.monotonic() < end
            time.sleep(0.1)
    finally:
        if first.poll() is None:
            os.killpg(first.pid, signal.SIGKILL)
