"""A classifier learns from a camera that is named, and never looks at another one."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from rich.console import Console

from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import DatasetError, FieldError
from svfl_data.sampling.centering_samples import load_centering
from svfl_data.schema.episode import Episode
from svfl_data.storage.store import write_episode
from svfl_data.symmetry import OFFSET_PARTS, act, nearest_direction
from svfl_models import cli
from svfl_models.centering import train
from svfl_models.centering.checkpoint import configuration, load_classifier
from svfl_models.centering.config import TrainingConfig
from svfl_models.centering.evaluate import evaluate
from svfl_models.deployment import export, predictions
from svfl_models.training import run_folder
from tests.helpers.builders import make_episode

pytestmark = pytest.mark.slow

QUIET = Console(quiet=True)
COUNT, SIZE = 12, 20
QUARTER = np.array([[0.0, -1.0], [1.0, 0.0]])
"""Rotation of the other camera's images about the vertical, [-]."""


def seen_by_two(index):
    """An episode that a second camera has seen as well, from the other side, with images of its own."""
    made = make_episode(index, steps=2, size=SIZE)
    rng = np.random.default_rng([3, index])
    offset = rng.normal(0, 0.03, 2)
    labels = {
        "labels/offset": offset,
        "labels/direction": np.array(
            nearest_direction(act(made.cameras["front"].image_axes, offset, OFFSET_PARTS)), np.int64
        ),
    }
    other = {path.replace("front", "above"): array for path, array in made.arrays.items() if "cameras/front" in path}
    other["cameras/above/color"] = 255 - other["cameras/above/color"]
    turned = np.eye(4)
    turned[:2, :2] = QUARTER
    other["cameras/above/T_base_camera"] = turned @ other["cameras/above/T_base_camera"]
    other["cameras/above/image_axes"] = other["cameras/above/image_axes"] @ QUARTER.T
    return replace(made, arrays=made.arrays | other | labels)


def written(folder, change=lambda episode: episode):
    Dataset.create_or_resume(folder, "centering", 0, {})
    for index in range(COUNT):
        write_episode(change(seen_by_two(index)), folder / Dataset.file_name(index))
    return folder


def noisy(*cameras):
    """The change of an episode that overwrites the images of cameras with noise."""

    def change(episode):
        rng = np.random.default_rng(episode.meta.index)
        new = {}
        for camera in cameras:
            color, depth = (episode.arrays[f"cameras/{camera}/{name}"] for name in ("color", "depth"))
            new[f"cameras/{camera}/color"] = rng.integers(0, 256, color.shape).astype(np.uint8)
            new[f"cameras/{camera}/depth"] = rng.integers(1, 9999, depth.shape).astype(np.uint16)
        return replace(episode, arrays=episode.arrays | new)

    return change


def without(camera):
    def change(episode):
        kept = {path: array for path, array in episode.arrays.items() if f"cameras/{camera}/" not in path}
        return Episode(episode.meta, kept, name=episode.name)

    return change


def config(folder, encoder="vf", **changes):
    chosen = {"preset": "tiny", "image_size": 8, "train_samples": 4, "test_samples": 2, "epochs": 1, "group": "none"}
    return TrainingConfig(str(folder), encoder=encoder, **chosen | changes)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return written(tmp_path_factory.mktemp("data") / "two")


@pytest.fixture(scope="module")
def trained(folder, tmp_path_factory):
    out = tmp_path_factory.mktemp("out") / "front"
    train.train_centering(config(folder, camera="front"), out, console=QUIET)
    return out / run_folder.CHECKPOINT


def outputs(file, folder):
    module = load_classifier(file)
    known = configuration(module, folder)
    return evaluate(module, train.samples_of(folder, known), known).predicted, predictions.load(file)


def test_of_several_cameras_one_must_be_named(folder, tmp_path, capsys):
    with pytest.raises(DatasetError, match=r"--camera.*above, front"):
        train.train_centering(config(folder), tmp_path / "none", console=QUIET)
    with pytest.raises(DatasetError, match=r"no camera wrist.*above, front"):
        train.train_centering(config(folder, camera="wrist"), tmp_path / "none", console=QUIET)
    table = (
        "centering-table",
        "--data",
        folder,
        "--train-samples",
        "4",
        "--test-samples",
        "2",
        "--out",
        tmp_path / "t",
    )
    for command in (("centering", "--data", folder, "--out", tmp_path / "none"), table):
        assert cli.main(list(map(str, command))) == 1
        assert capsys.readouterr().err.count("--camera") == 1
    assert not any((tmp_path / name).exists() for name in ("none", "t"))


def test_a_network_without_images_needs_no_camera(folder, tmp_path):
    train.train_centering(config(folder, "f"), tmp_path / "f", console=QUIET)
    found = predictions.load(tmp_path / "f" / run_folder.CHECKPOINT)(seen_by_two(0))
    assert (found.seen, found.probabilities.shape) == (None, (3, 4))


def test_a_camera_that_moves_has_no_axes_to_learn_in(tmp_path):
    """It is in nobody's way without images, although its name comes first."""

    def moving(episode):
        arrays = {path: array for path, array in episode.arrays.items() if path != "cameras/above/image_axes"}
        pose = arrays.pop("cameras/above/T_base_camera")
        frames = len(arrays["cameras/above/t_ns"])
        return replace(
            episode, arrays=arrays | {"cameras/above/T_base_camera_per_frame": np.tile(pose, (frames, 1, 1))}
        )

    folder = written(tmp_path / "moving", moving)
    assert len(load_centering(folder, inputs=("wrench",))) == COUNT
    with pytest.raises(FieldError, match=r"episode_000000\.hdf5.*camera above was recorded without image_axes"):
        load_centering(folder, camera="above")


def test_the_only_camera_needs_no_name(tmp_path):
    folder = written(tmp_path / "one", without("above"))
    train.train_centering(config(folder), tmp_path / "out", console=QUIET)
    kept = configuration(load_classifier(tmp_path / "out" / run_folder.CHECKPOINT))
    assert kept.camera == "front"
    assert "| camera | front |" in (tmp_path / "out" / run_folder.REPORT).read_text()


def test_samples_are_in_the_axes_of_the_camera_that_is_named(folder):
    front, above = (load_centering(folder, camera=camera) for camera in ("front", "above"))
    np.testing.assert_allclose(above.offset, front.offset @ QUARTER, atol=1e-7)
    np.testing.assert_array_equal(above.direction, nearest_direction(above.offset))
    np.testing.assert_array_equal(above.direction, (front.direction - 1) % 4)
    np.testing.assert_allclose(above.image[:, :3], 1 - front.image[:, :3], atol=1e-6)
    blind = load_centering(folder, inputs=("wrench",), camera="above")
    np.testing.assert_array_equal(blind.wrench, above.wrench)


@pytest.mark.parametrize("view", ["camera", "top"])
def test_what_another_camera_sees_changes_nothing(folder, tmp_path, view):
    """Training and test, with the images of the other camera replaced by noise: the same weights to the last bit."""
    files = []
    for name, change in (("clean", noisy()), ("noise", noisy("above"))):
        data = written(tmp_path / name, change)
        train.train_centering(config(data, camera="front", view=view), tmp_path / f"out_{name}", console=QUIET)
        files.append(load_classifier(tmp_path / f"out_{name}" / run_folder.CHECKPOINT).state_dict())
    clean, noise = files
    assert all(torch.equal(clean[name], noise[name]) for name in clean)


def test_predictions_are_of_the_named_camera_only(folder, trained, tmp_path):
    predicted, network = outputs(trained, folder)
    other, _ = outputs(trained, written(tmp_path / "above_noisy", noisy("above")))
    np.testing.assert_array_equal(predicted, other)
    episode = seen_by_two(0)
    shown = network(episode)
    assert shown.camera == "front"
    np.testing.assert_array_equal(network(noisy("above")(episode)).probabilities, shown.probabilities)
    assert not np.array_equal(network(noisy("front")(episode)).probabilities, shown.probabilities)


def test_an_episode_without_the_camera_is_refused_in_one_line(trained, tmp_path, capsys):
    folder = written(tmp_path / "lacks", without("front"))
    with pytest.raises(DatasetError, match=r"no camera front.*above"):
        predictions.load(trained)(Dataset.open(folder).read(0))
    assert cli.main(["check", str(trained), "--data", str(folder)]) == 1
    err = capsys.readouterr().err
    assert (err.count("\n"), "no camera front" in err) == (1, True)


def test_an_older_checkpoint_takes_the_only_camera(trained, tmp_path):
    found = torch.load(trained, weights_only=True)
    del found["hyper_parameters"]["training"]["camera"]
    torch.save(found, tmp_path / "older.ckpt")
    network, episode = predictions.load(tmp_path / "older.ckpt"), seen_by_two(0)
    assert network(without("above")(episode)).camera == "front"
    with pytest.raises(DatasetError, match=r"--camera.*front"):
        network(episode)


def test_an_exported_file_names_its_camera(trained, tmp_path):
    assert cli.main(["export", str(trained), "--out", str(tmp_path / "c.pt2")]) == 0
    module = load_classifier(trained)
    assert export.facts(module.classifier, camera=configuration(module).camera)["camera"] == "front"
    from svfl_models.programs.program import read

    assert '"camera": "front"' in read(tmp_path / "c.pt2", export.FACTS)[1]
