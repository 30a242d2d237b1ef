"""A disk that fills up, for every program that replaces a file: what was there before stays, and nothing else does.

Once with a file system that is really small (root may mount one), its temporary folder on another; and once, for
everybody, with writes that are refused when they should reach the disk.
"""

import ast
import errno
import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from matplotlib.figure import Figure
from rich.console import Console

from collectors.apriltags import print_files
from collectors.apriltags.layout import Layout
from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import StorageError, SvflError
from svfl_data.reports import plot
from svfl_data.storage.store import write_episode
from svfl_data.system.atomic_io import write_atomically
from svfl_data.viewer import show
from svfl_data.viewer.entities.episode_source import EpisodeSource
from svfl_models.centering.checkpoint import load_classifier
from svfl_models.centering.classifier import CenteringClassifier
from svfl_models.centering.config import TrainingConfig
from svfl_models.centering.train import train_centering
from svfl_models.cloning.checkpoint import load_policy
from svfl_models.cloning.config import CloningConfig
from svfl_models.cloning.evaluate import Evaluation
from svfl_models.cloning.train import train_cloning
from svfl_models.deployment import export
from svfl_models.latent import config as presets
from svfl_models.latent.checkpoint import load_latent
from svfl_models.latent.config import LatentConfig
from svfl_models.latent.train import train_latent
from svfl_models.programs import exported_policy
from svfl_models.training import progress, run_folder, writing
from svfl_models.training.checkpoint_plugin import WholeCheckpoints
from tests.helpers.builders import make_episode
from tests.helpers.demonstrations import demonstrations
from tests.helpers.latent_small import SIZES, lifting, written
from tests.helpers.replay_episodes import agent_buffer

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[1]
BEFORE = b"what was there before"
QUIET = Console(quiet=True)


class Network(torch.nn.Module):
    def __init__(self):
        super().__init__()
        self.layer = torch.nn.Linear(5, 5)

    def forward(self, image, wrench, proprio):
        return self.layer(proprio) + image.mean() + wrench.mean()


def classifier():
    return CenteringClassifier("f", "none", "tiny").eval()


def figure():
    found = Figure()
    found.subplots().plot([1, 2])
    return found


WRITERS = {
    "checkpoint.ckpt": lambda file: WholeCheckpoints().save_checkpoint({"weights": torch.zeros(9)}, file),
    "policy.pt2": lambda file: exported_policy.save(Network(), file, (8, 8)),
    "classifier.pt2": lambda file: export.save_program(classifier(), file),
    "classifier.onnx": lambda file: export.save_onnx(classifier(), file),
    "buffer.replay": lambda file: agent_buffer(4, capacity=12).save(file),
    "episode.rrd": lambda file: show.save(show.content([(EpisodeSource.of(make_episode(0)), None)]), file),
    "episode.png": lambda file: plot.save(make_episode(0), file),
    "episode.hdf5": lambda file: write_episode(make_episode(0), file),
    "evaluation.json": lambda file: Evaluation("x", "y", 0, [True], [3]).save(file),
    "page.pdf": lambda file: print_files.write([], file),
    "layout.json": lambda file: Layout.grid(2, 2, 0.02, 0.03).write(file),
    "page.md": lambda file: writing.write_text(file, "page"),
    "result.json": lambda file: writing.write_json(file, {}),
    "runs.csv": lambda file: writing.write_rows(file, [[1, 2]]),
    "curve.png": lambda file: writing.write_figure(figure(), file, 50),
    "copy.png": lambda file: writing.copy_file(ROOT / "README.md", file),
    "any": lambda file: write_atomically(file, b"later"),
}


@pytest.mark.parametrize("name", WRITERS)
def test_a_full_disk_costs_nothing_that_was_there(name, disk, capfd):
    file = disk.folder / name
    file.write_bytes(BEFORE)
    disk.fill()
    names = sorted(os.listdir(disk.folder))
    with pytest.raises(StorageError, match=re.escape(str(file))) as caught:
        WRITERS[name](file)
    assert os.strerror(errno.ENOSPC) in str(caught.value)
    assert file.read_bytes() == BEFORE
    assert sorted(os.listdir(disk.folder)) == names
    assert capfd.readouterr().err == ""


@pytest.fixture(scope="module")
def trainings(tmp_path_factory):
    """For each program that trains: how, and what opens its checkpoint."""
    folder = tmp_path_factory.mktemp("data")
    Dataset.create_or_resume(folder / "centering", "centering", seed=0, config={})
    for index in range(16):
        episode = make_episode(index, steps=3, size=76, angle=index % 4 * np.pi / 2 + 0.1)
        write_episode(episode, folder / "centering" / Dataset.file_name(index))
    shown, picking = demonstrations(folder / "shown"), written(folder / "picking", map(lifting, range(5)))
    centering = TrainingConfig(
        str(folder / "centering"), encoder="f", group="none", preset="tiny", train_samples=8, test_samples=8, epochs=9
    )
    cloning = CloningConfig(str(shown), 6, encoder="fp", group="none", preset="tiny", image_size=8, valid=1 / 3)
    latent = LatentConfig(str(picking), "poe", steps=40, checkpoint_every=2, batch_size=4, sequence=3)
    return {
        "centering": (lambda out: train_centering(centering, out, console=QUIET), load_classifier),
        "bc": (lambda out: train_cloning(replace(cloning, epochs=9), out, QUIET), load_policy),
        "latent": (lambda out: train_latent(latent, out, console=QUIET), load_latent),
    }


@pytest.mark.parametrize("program", ["centering", "bc", "latent"])
def test_a_disk_that_fills_up_leaves_the_last_checkpoint(program, trainings, disk, monkeypatch):
    monkeypatch.setitem(presets.PRESETS, "svfl_2023", replace(presets.PRESETS["svfl_2023"], sizes=SIZES))
    train, load = trainings[program]
    out, kept = disk.folder / "run", []
    append = progress.MetricsFile.on_train_epoch_end

    def fill_when_there_is_one(callback, trainer, module):
        append(callback, trainer, module)
        if (out / run_folder.CHECKPOINT).exists() and not kept:
            kept.append((out / run_folder.CHECKPOINT).read_bytes())
            disk.fill()

    monkeypatch.setattr(progress.MetricsFile, "on_train_epoch_end", fill_when_there_is_one)
    with pytest.raises(StorageError, match=os.strerror(errno.ENOSPC)) as caught:
        train(out)
    assert "\n" not in str(caught.value)
    assert (out / run_folder.CHECKPOINT).read_bytes() == kept[0]
    load(out / run_folder.CHECKPOINT)
    assert not [name for name in os.listdir(out) if name.endswith(".part")]


def test_a_full_disk_before_anything_begins_is_one_line(trainings, disk, monkeypatch):
    monkeypatch.setitem(presets.PRESETS, "svfl_2023", replace(presets.PRESETS["svfl_2023"], sizes=SIZES))
    disk.fill()
    for name, (train, _) in trainings.items():
        with pytest.raises(SvflError, match=os.strerror(errno.ENOSPC)) as caught:
            train(disk.folder / name)
        assert "\n" not in str(caught.value)


ELSEWHERE = {
    "collectors/teleop/devices/script.py": "a log that is written while a session goes on",
    "collectors/simulation/arms/torque_arm.py": "a file in a temporary folder, gone a moment later",
    "collectors/sources/tagged_block.py": "likewise",
    "collectors/tasks/household_objects.py": "the table of this package itself, made by its authors",
    "svfl_models/training/progress.py": "a row is appended",
    "svfl_models/experiments/runs/run_cache.py": "a folder is copied, then renamed",
    "svfl_data/viewer/entities/images.py": "a picture in memory",
    "svfl_models/training/figures.py": "a figure in memory",
    "svfl_models/training/writing.py": "a figure in memory",
    "svfl_models/training/checkpoint_plugin.py": "a checkpoint in memory",
    "svfl_models/deployment/export.py": "a program in memory",
    "svfl_models/programs/exported_policy.py": "a program in memory",
    "svfl_models/programs/own_policy.py": "likewise",
    "svfl_data/reports/plot.py": "a figure in memory",
    "svfl_data/storage/header_cache.py": "a cache, whose entries carry their own hash",
}
"""Files that may use what replaces a file at once, and why."""
AT_ONCE = {"write_text", "write_bytes", "savefig", "imwrite", "copyfile", "tofile", "savez"}


def replaces_at_once(node):
    """Whether a call of Python replaces a file in place, as far as its name tells."""
    if not isinstance(node, ast.Call) or not isinstance(node.func, ast.Attribute | ast.Name):
        return False
    name = node.func.attr if isinstance(node.func, ast.Attribute) else node.func.id
    owner = ast.unparse(node.func.value) if isinstance(node.func, ast.Attribute) else ""
    if name == "open":
        modes = [*node.args[: 1 if owner else 2], *(one.value for one in node.keywords if one.arg == "mode")]
        return any(isinstance(one, ast.Constant) and re.fullmatch("[wax]b?", str(one.value)) for one in modes)
    if name == "write_text":
        return owner != ""
    if name in ("copy", "copy2", "copytree"):
        return owner == "shutil"
    return name in AT_ONCE or (name == "save" and owner in ("torch", "torch.export", "np", "numpy"))


def test_every_file_is_replaced_by_the_one_function():
    found = {
        str(file.relative_to(ROOT))
        for package in ("svfl_data", "svfl_models", "collectors")
        for file in (ROOT / package).rglob("*.py")
        if any(replaces_at_once(node) for node in ast.walk(ast.parse(file.read_text())))
    }
    assert found <= ELSEWHERE.keys(), sorted(found - ELSEWHERE.keys())
