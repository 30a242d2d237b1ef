"""A latent model learns from a camera that is named, and is evaluated on the same one."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from rich.console import Console

from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import DatasetError
from svfl_data.schema.episode import Episode
from svfl_models import cli
from svfl_models.latent.checkpoint import load_latent
from svfl_models.latent.config import LatentConfig
from svfl_models.latent.evaluation.episodes import material
from svfl_models.latent.recordings import load_recordings
from svfl_models.latent.train import train_latent
from svfl_models.training import run_folder
from tests.helpers.latent_small import lifting, written

pytestmark = pytest.mark.slow

QUIET = Console(quiet=True)


def seen_by_two(index, noise=()):
    """An episode that a second camera has seen as negatives; the images of cameras in `noise` are noise."""
    made = lifting(index)
    other = {path.replace("front", "above"): array for path, array in made.arrays.items() if "cameras/front" in path}
    other["cameras/above/color"] = 255 - other["cameras/above/color"]
    arrays = made.arrays | other
    for camera in noise:
        path = f"cameras/{camera}/color"
        arrays[path] = np.random.default_rng(index).integers(0, 256, arrays[path].shape).astype(np.uint8)
    return replace(made, arrays=arrays)


def without(episode, camera):
    kept = {path: array for path, array in episode.arrays.items() if f"cameras/{camera}/" not in path}
    return Episode(episode.meta, kept, name=episode.name, declarations=episode.declarations)


def config(folder, **changes):
    return LatentConfig(str(folder), "concat", **{"steps": 2, "batch_size": 2, "sequence": 4} | changes)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return written(tmp_path_factory.mktemp("data") / "two", [seen_by_two(index) for index in range(5)])


@pytest.fixture(scope="module")
def trained(folder, tmp_path_factory):
    out = tmp_path_factory.mktemp("out") / "front"
    train_latent(config(folder, camera="front"), out, console=QUIET)
    return out / run_folder.CHECKPOINT


def test_of_several_cameras_one_must_be_named(folder, tmp_path, capsys):
    with pytest.raises(DatasetError, match=r"--camera.*above, front"):
        train_latent(config(folder), tmp_path / "none", console=QUIET)
    with pytest.raises(DatasetError, match=r"no camera wrist.*above, front"):
        train_latent(config(folder, camera="wrist"), tmp_path / "none", console=QUIET)
    assert cli.main(["latent", "--model", "poe", "--data", str(folder), "--out", str(tmp_path / "none")]) == 1
    assert capsys.readouterr().err.count("--camera") == 1
    assert not (tmp_path / "none").exists()


def test_recordings_are_of_the_camera_that_is_named(folder):
    front, above = (load_recordings(Dataset.open(folder), 0.5, camera=camera)[0] for camera in ("front", "above"))
    np.testing.assert_array_equal(above.color, 255 - front.color)


def test_what_another_camera_sees_changes_nothing(folder, trained, tmp_path):
    """A training with the images of the other camera replaced by noise gives the same weights to the last bit."""
    noisy = written(tmp_path / "noise", [seen_by_two(index, noise=["above"]) for index in range(5)])
    train_latent(config(noisy, camera="front"), tmp_path / "out", console=QUIET)
    clean, noise = (load_latent(file).state_dict() for file in (trained, tmp_path / "out" / run_folder.CHECKPOINT))
    assert all(torch.equal(clean[name], noise[name]) for name in clean)


def test_the_only_camera_needs_no_name_and_resuming_keeps_it(tmp_path):
    folder = written(tmp_path / "one", [without(seen_by_two(index), "front") for index in range(5)])
    train_latent(config(folder), tmp_path / "out", console=QUIET)
    assert load_latent(tmp_path / "out" / run_folder.CHECKPOINT).hparams["training"]["camera"] == "above"
    train_latent(config(folder, steps=3), tmp_path / "out", console=QUIET)


def test_an_evaluation_takes_the_camera_of_the_training(folder, trained, tmp_path):
    module = load_latent(trained)
    given = material(module, None, 5, 0)
    assert given.evaluated.camera == given.learned.camera == "front"
    (front, *_) = load_recordings(Dataset.open(folder), 0.5, camera="front")
    one = next(one for one in (*given.learned.recordings, *given.evaluated.recordings) if one.index == front.index)
    np.testing.assert_array_equal(one.color, front.color)
    lacks = written(tmp_path / "lacks", [without(seen_by_two(index), "front") for index in range(5)])
    with pytest.raises(DatasetError, match=r"no camera front.*above"):
        material(module, lacks, 5, 0)


def test_an_older_checkpoint_takes_the_only_camera(trained, tmp_path):
    module = load_latent(trained)
    del module.hparams["training"]["camera"]
    with pytest.raises(DatasetError, match=r"--camera.*front"):
        material(module, None, 5, 0)
