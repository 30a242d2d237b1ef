"""Behaviour cloning of a robot with inputs and actions of its own: batches, symmetry, checkpoints, programs."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from rich.console import Console

from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import DatasetError, TrainingError, UsageError
from svfl_data.sampling.samples import Samples
from svfl_data.storage.store import write_episode
from svfl_data.symmetry import WRENCH_PARTS, act
from svfl_models import cli
from svfl_models.cloning import acting
from svfl_models.cloning.checkpoint import load_policy
from svfl_models.cloning.config import CloningConfig
from svfl_models.cloning.data import CloningData
from svfl_models.cloning.evaluate import evaluate
from svfl_models.cloning.own_acting import OwnActingPolicy
from svfl_models.cloning.own_data import picture
from svfl_models.cloning.recorded_inputs import recorded_input
from svfl_models.cloning.train import network_of, train_cloning
from svfl_models.networks.action_space import ActionSpace
from svfl_models.networks.input_types import actions_of
from svfl_models.networks.policy import Policy
from svfl_models.programs import own_policy
from svfl_models.symmetry.actions import act_on_parts
from svfl_models.symmetry.groups import GROUPS
from svfl_models.training import run_folder
from tests.helpers.open_episode import dataset_of, open_episode
from tests.helpers.own_robot import ACTION, CENTRE, IMAGE_AXES, own_dataset, own_episode

INPUTS = [
    "cameras/front", "cameras/wrist", "streams/wrench/wrench=8@500", "streams/left_finger/wrench=8@500:invariant",
    "observations/tcp_velocity", "observations/tcp_position", "streams/tactile/pressure=3@100",
]  # fmt: skip
QUIET = Console(quiet=True)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return own_dataset(tmp_path_factory.mktemp("data") / "mine").path


def config(folder, **changes):
    given = {"episodes": 5, "preset": "tiny", "image_size": 8, "inputs": INPUTS, "valid": 0.2, "epochs": 2}
    return CloningConfig(str(folder), **(given | changes))


@pytest.fixture(scope="module")
def trained(folder, tmp_path_factory):
    out = tmp_path_factory.mktemp("run") / "own"
    result = train_cloning(config(folder), out, QUIET)
    return out / run_folder.CHECKPOINT, result


def test_a_batch_is_what_was_recorded_in_the_axes_of_the_image(folder):
    data = CloningData(config(folder, augment=False))
    part = data.valid_set
    (index,) = part.samples.episodes
    episode = Dataset.open(folder).read(index)
    batch = part.batch(range(len(part)))
    for step in range(len(episode)):
        rows = np.searchsorted(episode.wrench_t_ns, episode.t_ns[step], side="right") + np.arange(-8, 0)
        expected = act(IMAGE_AXES, episode.tared_wrench[rows], WRENCH_PARTS)
        np.testing.assert_allclose(batch["streams/wrench/wrench"][step], expected, atol=1e-5)
        finger = episode["streams/left_finger/wrench"][rows]
        np.testing.assert_allclose(batch["streams/left_finger/wrench"][step], finger, atol=1e-6)
        place = episode["observations/tcp_position"][step]
        np.testing.assert_allclose(
            batch["observations/tcp_position"][step], [*(IMAGE_AXES @ (place[:2] - CENTRE)), place[2]], atol=1e-6
        )
        moved = act(IMAGE_AXES, episode.action[step], ActionSpace.of(ACTION).parts)
        np.testing.assert_allclose(batch["action"][step], moved, atol=1e-6)
    assert batch["cameras/front"].shape == (6, 4, 8, 8)
    assert batch["cameras/wrist"].shape == (6, 3, 8, 8)
    assert batch["streams/tactile/pressure"].shape == (6, 3, 32)


def test_the_whole_policy_turns_with_the_world(folder):
    """In base axes, with images and positions about the workspace's centre; untrained and in eval mode."""
    data = CloningData(config(folder))
    torch.manual_seed(0)
    network = Policy(**network_of(config(folder), data.deployment))
    policy = OwnActingPolicy(network, replace(data.deployment, switch=False)).eval()
    values = [torch.randn(4, *one.shape) for one in policy.inputs]
    axes, space = np.array(data.deployment.image_axes), ActionSpace.of(ACTION)
    moving = actions_of([one.network() for one in policy.inputs])
    centre = {one.path: torch.tensor(one.maps(axes)[1]).float() for one in policy.inputs if one.kind != "image"}
    pairs = list(zip(policy.inputs, values, strict=True))
    square = [value[..., 1:11] if one.path == "cameras/front" else value for one, value in pairs]
    with torch.no_grad():
        said = policy(*square)
        for matrix in GROUPS["D4"].elements:
            in_image = axes @ matrix @ axes.T
            turned = [
                moving[one.path](in_image, value)
                if one.kind == "image"
                else moving[one.path](matrix, value - centre[one.path]) + centre[one.path]
                for one, value in zip(policy.inputs, square, strict=True)
            ]
            expected = act_on_parts(space.parts)(matrix, said)
            torch.testing.assert_close(space.to_unit(policy(*turned)), space.to_unit(expected), atol=2e-5, rtol=1e-4)


def test_a_checkpoint_is_a_program_for_the_robot(trained, folder, tmp_path):
    checkpoint, result = trained
    assert result.valid_xy_mm is None
    assert 0 < result.valid_error < 1
    module = load_policy(checkpoint)
    assert acting.export(module, tmp_path / "policy.pt2") < 1e-4
    policy = own_policy.load(tmp_path / "policy.pt2")
    assert [one.path for one in policy.facts.inputs] == [word.split("=")[0] for word in INPUTS]
    assert policy.facts.components == ["dx", "dy", "dz", "rx", "ry", "rz", "opening"]
    sample = Samples(
        Dataset.open(folder), [0], windows={"streams/wrench/wrench": 8, "streams/left_finger/wrench": 8,
                                           "streams/tactile/pressure": 3},
    )[2]  # fmt: skip
    values = {
        path: array[0] if path.startswith("cameras/") and array.ndim > 1 else array for path, array in sample.items()
    }
    action = policy(values)
    assert action.shape == (7,)
    assert (np.abs(action) <= np.array([0.02] * 3 + [0.1] * 3 + [1]) + 1e-6).all()
    assert action[6] in (0, 1)
    del values["streams/tactile/pressure"]
    with pytest.raises(TrainingError, match=r"policy\.pt2.*streams/tactile/pressure.*observations/tcp_velocity"):
        policy(values)
    with pytest.raises(TrainingError, match=r"cameras/wrist/color.*\(9, 10, 3\).*\(10, 10, 3\)"):
        policy(values | {"cameras/wrist/color": np.zeros((9, 10, 3), np.uint8),
                         "streams/tactile/pressure": np.zeros((3, 32))})  # fmt: skip
    with pytest.raises(TrainingError, match=r"cannot be evaluated in .*svfl/wiping-v0"):
        evaluate(checkpoint, 1)


def test_an_interrupted_training_goes_on_as_if_it_had_not_been(trained, folder, tmp_path):
    checkpoint, result = trained
    again = train_cloning(config(folder), tmp_path / "again", QUIET)
    assert again.train_loss == result.train_loss
    one, other = (load_policy(file).state_dict() for file in (checkpoint, tmp_path / "again" / run_folder.CHECKPOINT))
    assert all(torch.equal(value, other[name]) for name, value in one.items())


@pytest.mark.parametrize(
    ("changes", "error", "facts"),
    [
        ({"inputs": ["cameras/side"]}, UsageError, r"episode_000000\.hdf5.*'side'.*front, wrist"),
        ({"inputs": ["streams/tactile"]}, UsageError, r"'streams/tactile'.*streams/tactile/pressure"),
        ({"inputs": ["streams/wrench/wrench=0"]}, UsageError, "not an input.*streams/wrench/wrench=64@500"),
        ({"inputs": ["streams/wrench/wrench=8@100"]}, DatasetError, r"500 Hz.*8 readings at 100 Hz"),
        ({"inputs": ["streams/left_finger/wrench=8"]}, TrainingError, "left_finger.*no planar parts"),
        ({"inputs": ["observations/tcp_velocity=3"]}, UsageError, "no window"),
        ({"inputs": ["observations/tcp_velocity"] * 2}, UsageError, "named twice"),
        ({"action": "actions/left"}, UsageError, "'actions/left'.*actions/action"),
    ],
)
def test_what_cannot_be_learned_is_one_line(folder, changes, error, facts):
    with pytest.raises(error, match=facts) as caught:
        CloningData(config(folder, **changes))
    assert "\n" not in str(caught.value)


def test_without_symmetry_every_numeric_input_is_taken(folder):
    data = CloningData(config(folder, group="none", inputs=["streams/left_finger/wrench=8", "cameras/wrist"]))
    assert data.train_set.batch([0, 1])["streams/left_finger/wrench"].shape == (2, 8, 6)


def test_demonstrations_of_two_kinds_of_action_are_refused(tmp_path):
    dataset = own_dataset(tmp_path / "d", 4)
    other = own_episode(4)
    wide = replace(ACTION, bounds=tuple((2 * low, 2 * high) for low, high in ACTION.bounds))
    write_episode(replace(other, declarations=other.declarations.with_own([wide])), dataset.episode_path(4))
    with pytest.raises(DatasetError, match="actions/action"):
        CloningData(config(dataset.path))


def test_the_command(folder, tmp_path, capsys):
    words = ["bc", "--data", str(folder), "--episodes", "5", "--epochs", "1", "--preset", "tiny", "--image-size", "8"]
    words += ["--inputs", "streams/wrench/wrench=8@500", "observations/tcp_velocity", "--out", str(tmp_path / "o")]
    assert cli.main(words) == 1  # one of five cannot be held out with a tenth
    assert "too few" in capsys.readouterr().err


def test_no_network_takes_texts_or_times(tmp_path):
    """They are neither offered nor taken, also by a network without symmetry."""
    folder = dataset_of(tmp_path / "d", open_episode, 1).path
    reader = Dataset.open(folder).episode(0)
    for path in ("streams/notes/words", "streams/tactile/t_ns", "observations/t_ns", "workspace"):
        with pytest.raises(UsageError, match=f"no input '{path}'; there are .*streams/tactile/pressure") as found:
            recorded_input(path, reader, symmetric=False)
        assert path not in str(found.value).partition("there are")[2]


def test_grey_images_of_8_and_of_16_bits_are_learned_from(tmp_path):
    """All are from 0 to 1, and the program for the robot sees what the training saw."""
    dataset = Dataset.create_or_resume(tmp_path / "d", "wiping", 0, {})
    for index in range(5):
        episode = own_episode(index)
        color = episode["cameras/front/color"]
        grey = {"grey": color[..., 0], "grey16": color[..., 1].astype(np.uint16) * 257}
        arrays = {**episode.arrays, **{f"cameras/front/{leaf}": values for leaf, values in grey.items()}}
        write_episode(replace(episode, arrays=arrays), dataset.episode_path(index))
    data = CloningData(config(dataset.path, inputs=["cameras/front"], augment=False))
    assert data.deployment.inputs[0]["images"] == ("color", "grey", "grey16", "depth")
    recorded = data.valid_set.samples.batch([0])
    image = picture(data.valid_set.inputs[0], recorded)[0]
    assert image.shape == (6, 10, 12)
    torch.testing.assert_close(image[3:5], image[:2])  # the same numbers, whatever the number of bits
    program = own_policy.opened(
        own_policy.exported(Mean(), own_policy.Facts([
            own_policy.InputFacts("cameras/front", (6, 10, 12), ("color", "grey", "grey16", "depth"), 0.001)
        ], list("abcdef"), [-1e3] * 6, [1e3] * 6)), "mean",
    )  # fmt: skip
    said = program({path: values[0] for path, values in recorded.items()})
    np.testing.assert_allclose(said, image.mean(dim=(1, 2)), rtol=1e-5)


class Mean(torch.nn.Module):
    """Network whose actions are the means of the channels of its image."""

    def forward(self, image):
        return image.mean(dim=(2, 3))


def test_images_that_are_too_small_name_the_sizes_that_fit(folder):
    data = CloningData(config(folder, image_size=64))
    with pytest.raises(TrainingError, match=r"10 x 10 pixels, smaller than the network's 64 x 64; --image-size 8 fits"):
        data.train_set.batch([0])
