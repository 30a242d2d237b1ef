"""A disk that fills up while a program writes its report: the report before and every finished run stay, and when
there is room again, the same command finishes the work."""

import errno
import functools
import os

import numpy as np
import pytest

from svfl_data.datasets.dataset import Dataset
from svfl_data.storage.store import write_episode
from svfl_models import cli
from svfl_models.commands.experiments import COMMANDS
from svfl_models.experiments import cloning_table, command
from svfl_models.experiments.runs.training import Training
from svfl_models.latent.config import MODELS
from tests.helpers import latent_evaluated, pretend
from tests.helpers.builders import make_episode
from tests.helpers.demonstrations import demonstrations
from tests.helpers.pretend_cloning import Quick
from tests.helpers.pretrained import write_latent

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def material(tmp_path_factory):
    """What the programs need: datasets for each, and pretrained checkpoints."""
    folder = tmp_path_factory.mktemp("material")
    Dataset.create_or_resume(folder / "centering", "centering", seed=0, config={})
    for index in range(16):
        episode = make_episode(index, steps=3, size=76, angle=index % 4 * np.pi / 2 + 0.1)
        write_episode(episode, folder / "centering" / Dataset.file_name(index))
    demonstrations(folder / "block_picking")
    for model in MODELS:
        write_latent(folder / f"{model}.ckpt", model)
    latent_evaluated.trained(latent_evaluated.dataset(folder / "lifting"), folder / "poe")
    return folder


def words(program, folder, out, number):
    """The command line; a larger number is more work, so that something is left to do."""
    if program == "latent-eval":
        given = [folder / "poe" / "checkpoint.ckpt", "--episodes", 1, "--seed", number]
    elif program == "bc-table":
        given = ["--data", folder / "block_picking", "--episodes", 6, "--seeds", number, "--test-episodes", 4,
                 "--preset", "tiny", "--epochs", 2, "--copy-report-to", out / "docs"]  # fmt: skip
    else:
        given = ["--data", folder / "centering", "--test-samples", 8, "--train-samples", 8, "--epochs", 1,
                 "--preset", "tiny", "--seeds", number, "--workers", 1, "--copy-report-to", out / "docs"]  # fmt: skip
        if program == "centering-latents":
            given += ["--latents", *(folder / f"{model}.ckpt" for model in MODELS)]
    return [str(word) for word in (program, *given, "--out", out)]


def contents(folder):
    return {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()}


@pytest.mark.parametrize("program", [*(f"centering-{name}" for name in COMMANDS), "bc-table", "latent-eval"])
def test_a_report_that_finds_no_room(program, material, disk, monkeypatch, capfd):
    if program not in ("centering-table", "latent-eval"):  # these two really train and really evaluate
        monkeypatch.setattr(command, "Training", functools.partial(Training, train=pretend.train))
        monkeypatch.setattr(cloning_table, "Run", Quick)
    out = disk.folder / "out"
    assert cli.main(words(program, material, out, 1)) == 0
    before = contents(out)
    (page,) = out.glob("*.md")
    written = page.stat().st_mtime_ns
    capfd.readouterr()

    disk.fill()
    assert cli.main(words(program, material, out, 2)) == 1
    said = capfd.readouterr()
    last = said.err.splitlines()[-1]
    assert last.startswith("svfl-train: ")
    assert os.strerror(errno.ENOSPC) in last
    assert "Traceback" not in said.err
    after = contents(out)
    assert {file: after.get(file) for file in before} == before
    assert not [file for file in after if file.suffix == ".part"]

    disk.empty()
    assert cli.main(words(program, material, out, 2)) == 0
    assert page.stat().st_mtime_ns > written
