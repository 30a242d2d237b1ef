"""A camera that moves is a picture in the axes of the base for the network, in training, in acting and in a program."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from rich.console import Console

from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import TrainingError
from svfl_data.sampling.cut import cut_steps
from svfl_data.sampling.samples import Samples
from svfl_data.schema.input_spec import InputSpec
from svfl_models.cloning import acting
from svfl_models.cloning.checkpoint import load_policy
from svfl_models.cloning.config import CloningConfig
from svfl_models.cloning.data import CloningData
from svfl_models.cloning.own_acting import OwnActingPolicy
from svfl_models.cloning.recorded_inputs import recorded_input
from svfl_models.cloning.train import network_of, train_cloning
from svfl_models.networks.action_space import ActionSpace
from svfl_models.networks.image_crops import centre_crop, crop_side, scaled, turned
from svfl_models.networks.policy import Policy
from svfl_models.programs import own_policy
from svfl_models.symmetry.actions import act_on_image, act_on_parts
from svfl_models.symmetry.groups import GROUPS
from svfl_models.training import run_folder
from tests.helpers.own_robot import ACTION, IMAGE_AXES, moving_episode, own_dataset
from tests.helpers.replay_inputs import MOVING

INPUTS = ["cameras/front", "cameras/wrist", "observations/tcp_velocity"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return own_dataset(tmp_path_factory.mktemp("data") / "mine", 5, moving_episode).path


def config(folder, **changes):
    given = {"episodes": 5, "preset": "tiny", "image_size": 8, "inputs": INPUTS, "valid": 0.2, "epochs": 1}
    return CloningConfig(str(folder), **(given | changes))


def random_picture(side: int = 12) -> torch.Tensor:
    return torch.rand(2, 3, side, side, generator=torch.Generator().manual_seed(0))


@pytest.mark.parametrize("matrix", GROUPS["D4"].elements)
def test_turned_is_the_action_of_the_group_on_images(matrix):
    image = random_picture()
    moved = turned(image, torch.from_numpy(matrix).float().expand(2, 2, 2))
    torch.testing.assert_close(moved, act_on_image(matrix, image), atol=1e-5, rtol=0)
    if not np.allclose(matrix, np.eye(2)):
        assert (moved - image).abs().mean() > 0.1


def test_turned_there_and_back_is_the_same_inside_the_circle():
    place = torch.linspace(-1, 1, 64)
    smooth = torch.exp(-((place[:, None] - 0.2) ** 2 + (place + 0.3) ** 2) / 0.1)[None, None]
    c, s = np.cos(0.7), np.sin(0.7)
    matrix = torch.tensor([[[c, -s], [s, c]]]).float()
    back = turned(turned(smooth, matrix), matrix.transpose(1, 2))
    inside = place[:, None] ** 2 + place**2 < 0.9
    assert (back - smooth)[..., inside].abs().max() < 0.02


def test_how_a_camera_enters_the_network(folder):
    reader = Dataset.open(folder).episode(0)
    moves = {words: recorded_input(words, reader, True).moves for words in
             ("cameras/front", "cameras/wrist", "cameras/wrist:invariant", "cameras/front:invariant")}  # fmt: skip
    assert list(moves.values()) == ["pixels", "turned", "invariant", "invariant"]


def test_a_batch_has_the_picture_in_the_axes_of_the_policy(folder):
    part = CloningData(config(folder, augment=False)).valid_set
    (index,) = part.samples.episodes
    steps = range(len(part))
    recorded = cut_steps(Dataset.open(folder).read(index), InputSpec(cameras=("wrist",)), steps)
    image = torch.from_numpy(recorded["cameras/wrist/color"][:, 0] / np.float32(255)).permute(0, 3, 1, 2)
    axes = recorded["cameras/wrist/image_axes"][:, 0]
    expected = turned(image, torch.from_numpy(np.stack([IMAGE_AXES @ one.T for one in axes])).float())
    expected = scaled(centre_crop(expected, crop_side(10, 8)), 8)
    torch.testing.assert_close(part.batch(steps)["cameras/wrist"], expected, atol=1e-5, rtol=0)
    assert (expected - scaled(centre_crop(image, crop_side(10, 8)), 8)).abs().mean() > 0.1


def test_the_policy_turns_when_gripper_and_camera_turn_with_the_world(folder):
    """The picture of the camera on the gripper stays as it is; only its axes turn."""
    data = CloningData(config(folder))
    torch.manual_seed(0)
    policy = OwnActingPolicy(
        Policy(**network_of(config(folder), data.deployment)), replace(data.deployment, switch=False)
    ).eval()
    front, wrist, velocity = torch.rand(1, 4, 10, 10), torch.rand(1, 3, 10, 10), torch.randn(1, 3)
    camera, space = torch.tensor([[[0.6, 0.8], [-0.8, 0.6]]]), ActionSpace.of(ACTION)
    base, parts = np.array(IMAGE_AXES), policy.inputs[2].typed
    with torch.no_grad():
        said = policy(front, wrist, camera, velocity)
        for matrix in GROUPS["D4"].elements:
            moved = camera @ torch.from_numpy(matrix.T).float()
            told = policy(
                act_on_image(base @ matrix @ base.T, front), wrist, moved, act_on_parts(parts)(matrix, velocity)
            )
            expected = act_on_parts(space.parts)(matrix, said)
            torch.testing.assert_close(space.to_unit(told), space.to_unit(expected), atol=2e-5, rtol=1e-4)
        quarter = GROUPS["D4"].elements[1]
        liar = policy(
            act_on_image(base @ quarter @ base.T, front), wrist, camera, act_on_parts(parts)(quarter, velocity)
        )
        assert (space.to_unit(liar) - space.to_unit(act_on_parts(space.parts)(quarter, said))).abs().max() > 1e-3


def test_a_turned_transition_shows_the_turned_picture(tmp_path):
    """A replay buffer turns the axes of a frame, not its pixels: the picture that a network sees turns with the world.

    By every element of D4, and also where the camera looks up, so that its axes are mirrored already.
    """
    dataset = MOVING.dataset(tmp_path / "d")
    plain, other = (MOVING.preload(dataset, MOVING.config(rotate=on, crop=10)).sample(80) for on in (False, True))
    for camera in ("side", "wrist"):
        pictures, key = plain[f"cameras/{camera}/color"][:, 1], f"cameras/{camera}/image_axes"
        np.testing.assert_array_equal(other[f"cameras/{camera}/color"][:, 1], pictures)
        image = torch.from_numpy(pictures / np.float32(255)).permute(0, 3, 1, 2)
        before, after = (batch[key][:, 1].astype(float) for batch in (plain, other))
        seen, moved = (
            turned(image, torch.from_numpy(IMAGE_AXES @ axes.transpose(0, 2, 1)).float()) for axes in (before, after)
        )
        elements = np.round(IMAGE_AXES @ after.transpose(0, 2, 1) @ before @ IMAGE_AXES.T, 5)
        assert len({tuple((element + 0.0).ravel()) for element in elements}) == 8
        shown = image.flatten(1).any(dim=1)  # not before the first frame
        for row in np.flatnonzero(shown.numpy()).tolist():
            expected = act_on_image(elements[row], seen[row : row + 1])
            torch.testing.assert_close(moved[row : row + 1], expected, atol=1e-4, rtol=0)
            if not np.array_equal(elements[row], np.eye(2)):
                assert (seen[row : row + 1] - expected).abs().mean() > 0.02, "axes that stay show another picture"


def test_a_program_takes_the_axes_after_the_picture(folder, tmp_path):
    train_cloning(config(folder), tmp_path / "run", Console(quiet=True))
    module = load_policy(tmp_path / "run" / run_folder.CHECKPOINT)
    acting.export(module, tmp_path / "policy.pt2")
    policy = own_policy.load(tmp_path / "policy.pt2")
    assert [one.path for one in policy.facts.inputs] == [*INPUTS[:2], "cameras/wrist/image_axes", INPUTS[2]]
    sample = Samples(Dataset.open(folder), [0], windows={})[2]
    values = {path: array[0] if path.startswith("cameras/") and array.ndim > 1 else array
              for path, array in sample.items()}  # fmt: skip
    action = policy(values)
    other = policy(values | {"cameras/wrist/image_axes": np.array([[0.0, 1.0], [-1.0, 0.0]])})
    assert not np.array_equal(action, other)
    del values["cameras/wrist/image_axes"]
    with pytest.raises(TrainingError, match=r"takes cameras/wrist/image_axes; this robot gives .*cameras/wrist/color"):
        policy(values)
