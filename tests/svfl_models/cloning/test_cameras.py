"""A policy learns from a camera that is named, and acts on the same one, whatever other cameras there are."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from svfl_data.errors import DatasetError, TrainingError
from svfl_data.schema.robot import Frame, Observation
from svfl_models.cloning import acting, train
from svfl_models.cloning.checkpoint import load_policy
from svfl_models.cloning.config import CloningConfig
from svfl_models.cloning.data import CloningData
from svfl_models.deployment import predictions
from svfl_models.training import run_folder
from tests.helpers.demonstrations import demonstration, write

pytestmark = pytest.mark.slow

QUIET = Console(quiet=True)


def seen_by_two(index):
    """A demonstration that a second camera has seen as well: its images are negatives of the first one's."""
    made = demonstration(index)
    other = {path.replace("front", "above"): array for path, array in made.arrays.items() if "cameras/front" in path}
    other["cameras/above/color"] = 255 - other["cameras/above/color"]
    return replace(made, arrays=made.arrays | other)


def config(folder, **changes):
    chosen = {"preset": "tiny", "image_size": 8, "valid": 1 / 3, "epochs": 1} | changes
    return CloningConfig(str(folder), 6, "vp", **chosen)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write(tmp_path_factory.mktemp("data") / "two", [seen_by_two(index) for index in range(6)])


@pytest.fixture(scope="module")
def policies(folder, tmp_path_factory):
    """The checkpoint of a policy for each camera."""
    files = {}
    for camera in ("front", "above"):
        out = tmp_path_factory.mktemp(camera)
        train.train_cloning(config(folder, camera=camera), out, QUIET)
        files[camera] = out / run_folder.CHECKPOINT
    return files


def observation(frames):
    wrench, times = np.zeros((64, 6), np.float32), {"streams/wrench/t_ns": np.arange(-63, 1) * 2_000_000}
    return Observation(0, frames, wrench, np.zeros(5, np.float32), np.zeros(9, np.float32), values=times)


def frames(rng):
    """An image of each camera."""
    sizes = {"color": (10, 10, 3), "depth": (10, 10)}
    return {
        camera: Frame(
            rng.integers(0, 255, sizes["color"]).astype(np.uint8), rng.integers(1, 9999, sizes["depth"], np.uint16)
        )
        for camera in ("front", "above", "wrist")
    }


def test_of_several_cameras_one_must_be_named(folder):
    with pytest.raises(DatasetError, match=r"--camera.*above, front"):
        CloningData(config(folder))
    with pytest.raises(DatasetError, match=r"no camera wrist.*above, front"):
        CloningData(config(folder, camera="wrist"))
    assert CloningData(config(folder, camera="above")).deployment.camera == "above"


@pytest.mark.parametrize("camera", ["front", "above"])
@pytest.mark.parametrize("kind", ["ckpt", "pt2"])
def test_a_policy_acts_on_its_own_camera_only(policies, camera, kind, tmp_path):
    file = policies[camera]
    if kind == "pt2":
        acting.export(load_policy(file), file := tmp_path / "policy.pt2")
        from svfl_models.programs.exported_policy import load
    else:
        load = acting.load
    policy = load(file)
    given = frames(np.random.default_rng(0))
    action = policy(observation({camera: given[camera]}))
    for order in itertools.permutations(given):
        np.testing.assert_array_equal(policy(observation({name: given[name] for name in order})), action)
    del given[camera]
    with pytest.raises(TrainingError, match=f"takes images of {camera}.*{', '.join(given)}"):
        policy(observation(given))


def test_its_predictions_are_of_its_own_camera(policies):
    episode = seen_by_two(0)
    for camera, file in policies.items():
        assert predictions.load(file)(episode).camera == camera
