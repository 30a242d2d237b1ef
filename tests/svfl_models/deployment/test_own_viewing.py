"""What a policy with inputs and an action of its own commands, for the viewer: the same as on cut observations."""

import copy
from dataclasses import replace

import numpy as np
import pytest
import torch
from rich.console import Console

from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import DatasetError, SvflError
from svfl_data.sampling.samples import Samples
from svfl_data.schema.action_fields import pose_action
from svfl_data.schema.declarations import Declarations
from svfl_data.schema.episode import Episode
from svfl_data.schema.field import Field
from svfl_data.viewer import show
from svfl_data.viewer.entities.episode_source import EpisodeSource
from svfl_data.viewer.predictions import Prediction
from svfl_models.cloning import acting
from svfl_models.cloning.checkpoint import load_policy
from svfl_models.cloning.config import CloningConfig
from svfl_models.cloning.train import train_cloning
from svfl_models.deployment import predictions
from svfl_models.deployment.own_predictions import of_module
from svfl_models.programs import own_policy
from svfl_models.training import run_folder
from tests.helpers.own_robot import own_dataset, own_episode
from tests.helpers.rerun_files import entities, logged

pytestmark = pytest.mark.slow

INPUTS = [
    "cameras/front", "cameras/wrist", "streams/wrench/wrench=8@500", "streams/left_finger/wrench=8@500:invariant",
    "observations/tcp_velocity", "observations/tcp_position", "streams/tactile/pressure=3@100",
]  # fmt: skip
WINDOWS = {"streams/wrench/wrench": 8, "streams/left_finger/wrench": 8, "streams/tactile/pressure": 3}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return own_dataset(tmp_path_factory.mktemp("data") / "mine").path


@pytest.fixture(scope="module")
def files(folder, tmp_path_factory):
    """The checkpoint of a policy, and its program for the robot."""
    out = tmp_path_factory.mktemp("run") / "own"
    config = CloningConfig(str(folder), 5, preset="tiny", image_size=8, inputs=INPUTS, valid=0.2, epochs=1)
    train_cloning(config, out, Console(quiet=True))
    acting.export(load_policy(out / run_folder.CHECKPOINT), out / "policy.pt2")
    return {"ckpt": out / run_folder.CHECKPOINT, "pt2": out / "policy.pt2"}


def opened(file):
    return predictions.load(file) if file.suffix == ".ckpt" else predictions.load_exported(file)


@pytest.fixture(scope="module")
def expected(folder, files):
    """The program's actions on samples of episode 0, which are cut by `Samples`; the final observation has none."""
    policy = own_policy.load(files["pt2"])
    samples = Samples(Dataset.open(folder), [0], windows=WINDOWS)
    one_frame = [{path: array[0] if path.startswith("cameras/") and array.ndim > 1 else array
                  for path, array in samples[step].items()} for step in range(len(samples))]  # fmt: skip
    return np.stack([policy(values) for values in one_frame])


@pytest.mark.parametrize("kind", ["ckpt", "pt2"])
def test_predictions_are_the_policy_on_cut_observations(files, folder, expected, kind):
    episode = Dataset.open(folder).read(0)
    found = opened(files[kind])(episode)
    assert (found.camera, found.action, found.actions.shape) == ("", "actions/action", (7, 7))
    assert np.ptp(expected[:, :6], axis=0).min() > 0
    np.testing.assert_allclose(found.actions[:-1], expected, atol=1e-5)


def test_a_long_episode_is_predicted_in_pieces(files):
    module, episode = load_policy(files["ckpt"]), own_episode(0)
    whole, pieces, alone = (of_module(module, "policy", at_once)(episode).actions for at_once in (10**6, 3000, 1))
    np.testing.assert_allclose(whole, alone, atol=1e-5)
    np.testing.assert_allclose(whole, pieces, atol=1e-5)


@pytest.mark.parametrize("kind", ["ckpt", "pt2"])
def test_the_numbers_in_the_recording_are_those_of_the_policy(files, folder, expected, kind, tmp_path):
    """Beside the recorded curves, by unit, with the names of the components."""
    reader = Dataset.open(folder).episode(0)
    found = opened(files[kind])(reader.load())
    show.save(show.content([(EpisodeSource.of(reader), found)]), tmp_path / "own.rrd")
    for unit, columns, names in (
        ("unit_0", [0, 1, 2], ["dx, m network", "dy, m network", "dz, m network"]),
        ("unit_1", [3, 4, 5], ["rx, rad network", "ry, rad network", "rz, rad network"]),
        ("unit_2", [6], ["opening network"]),
    ):
        entity = f"fields/actions/action/{unit}/network"
        t_ns, values = logged(tmp_path / "own.rrd", entity, "Scalars:scalars")
        np.testing.assert_array_equal(t_ns, reader["observations/t_ns"][:])
        np.testing.assert_allclose(values[:-1], expected[:, columns], atol=1e-5)
        assert logged(tmp_path / "own.rrd", entity, "SeriesLines:names", timed=False) == names
        colors = [
            logged(tmp_path / "own.rrd", one, "SeriesLines:colors", timed=False)
            for one in (entity, entity.removesuffix("/network"))
        ]
        assert colors[0] == colors[1]
    assert not any(entity.startswith("/motion") for entity in entities(tmp_path / "own.rrd"))


def test_an_action_of_many_components_is_a_picture(tmp_path):
    made = own_episode(0)
    many = Field(path="actions/action", dtype="float32", shape=("N", 20))
    arrays = made.arrays | {"actions/action": np.zeros((6, 20), np.float32)}
    episode = Episode(made.meta, arrays, declarations=Declarations([many, *made.declarations.own[1:]]))
    actions = np.arange(140, dtype=np.float32).reshape(7, 20)
    prediction = Prediction("many", "", actions=actions)
    show.save(show.content([(EpisodeSource.of(episode), prediction)]), tmp_path / "many.rrd")
    tensor = logged(tmp_path / "many.rrd", "fields/actions/action/network", "Tensor:data", timed=False)
    assert tensor[0]["shape"] == [20, 7]


def without(episode, prefix):
    kept = {path: array for path, array in episode.arrays.items() if not path.startswith(prefix)}
    return replace(episode, arrays=kept)


def unfit(kind):
    """An episode that does not fit, and what the message says."""
    made = own_episode(0)
    if kind == "no camera":
        return without(made, "cameras/wrist/"), r"cameras/wrist/color.*not recorded.*cameras/front/color"
    if kind == "no stream":
        return without(made, "streams/tactile/"), r"streams/tactile/pressure.*not recorded.*streams/wrench/wrench"
    if kind == "image size":
        small = {"cameras/wrist/color": made.arrays["cameras/wrist/color"][:, :8]}
        return replace(made, arrays=made.arrays | small), r"cameras/wrist/color.*\(3, 10, 10\).*\(8, 10, 3\)"
    if kind == "depth scale":
        scale = {"cameras/front/depth_scale": np.array(0.01)}
        return replace(made, arrays=made.arrays | scale), r"depth_scale of 0\.001 m.*cameras/front.*0\.01 m"
    if kind == "rate":
        rates = made.meta.config["rates_hz"] | {"streams/wrench": 100}
        return replace(made, meta=replace(made.meta, config={"rates_hz": rates})), r"streams/wrench.*100 Hz.*500 Hz"
    if kind == "components":
        other = replace(pose_action(0.02, 0.1), components=("a", "b", "c", "d", "e", "f", "g"))
        return replace(made, declarations=made.declarations.with_own([other])), r"dx, dy.*a, b"
    other = Declarations([*made.declarations.own, replace(pose_action(0.02, 0.1), path="actions/left")])
    arrays = {path.replace("actions/action", "actions/left"): array for path, array in made.arrays.items()}
    return replace(made, arrays=arrays, declarations=other), r"actions/action.*not recorded.*actions/left"


@pytest.mark.parametrize(
    "kind", ["no camera", "no stream", "image size", "depth scale", "rate", "components", "no action"]
)
@pytest.mark.parametrize("file", ["ckpt", "pt2"])
def test_an_episode_that_does_not_fit_is_one_line(files, kind, file):
    episode, words = unfit(kind)
    with pytest.raises(DatasetError, match=words) as refused:
        opened(files[file])(episode)
    assert "\n" not in str(refused.value)


def test_the_action_is_the_one_that_was_learned(files, tmp_path):
    """A checkpoint of an action of another name, and a program that names none, as older ones do."""
    found = torch.load(files["ckpt"], weights_only=True)
    renamed = copy.deepcopy(found)
    renamed["hyper_parameters"]["training"]["action"] = "actions/left"
    torch.save(renamed, tmp_path / "left.ckpt")
    with pytest.raises(DatasetError, match=r"actions/left.*actions/action"):
        predictions.load(tmp_path / "left.ckpt")(own_episode(0))
    acting.export(load_policy(tmp_path / "left.ckpt"), tmp_path / "left.pt2")
    assert own_policy.load(tmp_path / "left.pt2").facts.action == "actions/left"


def test_a_file_that_is_no_policy_is_one_line(tmp_path):
    (tmp_path / "not.pt2").write_bytes(b"PK\x03\x04 not an archive")
    with pytest.raises(SvflError, match=r"not\.pt2"):
        predictions.load_exported(tmp_path / "not.pt2")
