"""A training with changed layers and settings is repeated from its folder, and opened by another process."""

import subprocess
import sys

import pytest
import torch

from svfl_data.datasets.dataset import Dataset
from svfl_data.storage.store import write_episode
from svfl_models import cli
from svfl_models.centering.checkpoint import load_classifier
from svfl_models.training import run_folder
from tests.helpers.builders import make_episode

WIDTHS = ["--set", "widths.latent=3", "--set", "widths.force=6"]


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    Dataset.create_or_resume(folder / "data", "centering", seed=0, config={})
    for index in range(8):
        write_episode(make_episode(index, steps=3, size=76), folder / "data" / f"episode_{index:06d}.hdf5")
    words = ["--train-samples", "4", "--test-samples", "4", "--epochs", "2", "--schedule", "constant"]
    words += ["--preset", "tiny", "--encoder", "f", "--learning-rate", "3e-3", *WIDTHS]
    assert cli.main(["centering", "--data", str(folder / "data"), *words, "--out", str(folder / "first")]) == 0
    return folder


def weights(folder):
    return torch.load(folder / run_folder.CHECKPOINT, weights_only=True)["state_dict"]


def same(first, second):
    return first.keys() == second.keys() and all(torch.equal(first[name], second[name]) for name in first)


def test_the_run_says_what_it_was(trained):
    found = run_folder.read_config(trained / "first")
    assert found["program"] == "centering"
    assert found["widths"] == {"latent": 3, "force": 6}
    assert (found["learning_rate"], found["schedule"]) == (3e-3, "constant")


def test_a_run_is_repeated_bit_for_bit(trained):
    assert cli.main(["rerun", str(trained / "first"), "--out", str(trained / "again")]) == 0
    assert same(weights(trained / "first"), weights(trained / "again"))
    assert cli.main(["rerun", str(trained / "first"), "--set", "seed=1"]) == 0
    other = trained / "first_rerun"
    assert run_folder.read_config(other)["seed"] == 1
    assert not same(weights(trained / "first"), weights(other))


def test_a_changed_network_opens_in_another_process_and_whatever_the_presets_become(trained):
    code = (
        "import sys, svfl_models.networks.presets as p; p.PRESETS.clear()\n"
        "from svfl_models.centering.checkpoint import load_classifier\n"
        "print(load_classifier(sys.argv[1]).classifier.trunk.encoders[0].__class__.__name__)"
    )
    checkpoint = str(trained / "first" / run_folder.CHECKPOINT)
    done = subprocess.run([sys.executable, "-c", code, checkpoint], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "ForceEncoder"
    assert load_classifier(checkpoint).hparams["network"]["widths"]["latent"] == 3


@pytest.mark.parametrize(
    ("content", "facts"),
    [(None, "holds no run.yaml"), ("program: evaluate\n", "is of evaluate"), ("data: x\n", "is of None")],
)
def test_what_is_no_run_is_not_repeated(tmp_path, content, facts, capsys):
    if content:
        (tmp_path / "run.yaml").write_text(content)
    assert cli.main(["rerun", str(tmp_path)]) == 2
    assert facts in capsys.readouterr().err
