"""What networks think of episodes, for the viewer: the same as where they act, and of the picture that is shown."""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch

from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import DatasetError, FormatError
from svfl_data.schema.episode import Episode
from svfl_models.cloning import acting
from svfl_models.cloning.config import VIEWS
from svfl_models.cloning.deployment_spec import deployment_of
from svfl_models.cloning.module import CloningModule
from svfl_models.deployment import predictions
from svfl_models.deployment.policy_predictions import of_module
from svfl_models.networks.action_space import PLANAR
from svfl_models.programs import exported_policy
from svfl_models.programs.program import read
from tests.helpers.builders import make_episode
from tests.helpers.demonstrations import demonstration, write
from tests.helpers.synthetic import centering_samples
from tests.helpers.trained import contents, untrained
from tests.helpers.trained import write as write_checkpoint

pytestmark = pytest.mark.slow

SIDE, SIZE = 19, 8
"""Of the pictures and of what the network sees, [px]; crops are 16 px."""

SCALE = np.array(PLANAR.scale)


@pytest.fixture(scope="module")
def episode():
    """The gripper is elsewhere above the table at every observation."""
    still = demonstration(steps=6, size=SIDE)
    proprio = still.proprio.copy()
    proprio[:, 1:3] = still.centre + np.linspace(-0.1, 0.1, len(proprio))[:, None] * [1, -1]
    return Episode(still.meta, still.arrays | {"observations/proprio": proprio}, name="episode")


@pytest.fixture(scope="module")
def deployment(episode, tmp_path_factory):
    return deployment_of(Dataset.open(write(tmp_path_factory.mktemp("data") / "picking", [episode])), [0])


def policy(deployment, view="gripper", encoder="vfp", size=SIZE):
    torch.manual_seed(0)
    network = {"encoder": encoder, "group": "none", "preset": "tiny", "image_size": size}
    return CloningModule(network, deployment.plain(), view=view).eval()


def prediction(module, episode, tmp_path):
    torch.save(contents(module), tmp_path / "policy.ckpt")
    return predictions.load(tmp_path / "policy.ckpt")(episode)


@pytest.mark.parametrize("view", VIEWS)
def test_what_is_shown_is_what_the_network_gets(deployment, episode, tmp_path, monkeypatch, view):
    got = []
    forward = acting.Policy.forward
    monkeypatch.setattr(acting.Policy, "forward", lambda self, batch: got.append(batch) or forward(self, batch))
    found = prediction(policy(deployment, view), episode, tmp_path)
    seen = torch.cat([batch["image"] for batch in got])[:, :3].movedim(1, -1).numpy() * 255
    assert found.seen.shape == (7, SIZE, SIZE, 3)
    np.testing.assert_allclose(found.seen, seen, atol=0.51)


@pytest.mark.parametrize("view", VIEWS)
def test_the_outline_is_around_what_is_seen(deployment, episode, tmp_path, view):
    found = prediction(policy(deployment, view, size=16), episode, tmp_path)  # crops as they are, not scaled
    for step, (left, top, right, bottom) in enumerate(found.crop):
        inside = [slice(max(0, low), min(high, SIDE)) for low, high in ((top, bottom), (left, right))]
        within = [slice(one.start - low, one.stop - low) for one, low in zip(inside, (top, left), strict=True)]
        assert right - left == bottom - top == 16
        np.testing.assert_array_equal(
            found.seen[step][*within], episode.cameras["front"].color[step][*inside], str(step)
        )


def test_a_policy_around_the_gripper_looks_at_the_table_below_it(deployment, episode, tmp_path):
    """By the camera's own calibration."""
    proprio, camera = episode.proprio, episode.cameras["front"]
    below = np.stack([proprio[:, 1], proprio[:, 2], np.full(7, deployment.table), np.ones(7)])
    column, row, scale = camera.intrinsics @ (np.linalg.inv(camera.T_base_camera) @ below)[:3]
    left, top, right, bottom = prediction(policy(deployment), episode, tmp_path).crop.T
    np.testing.assert_allclose((left + right) / 2, column / scale + 0.5, atol=0.51)  # pixel 0 spans 0 to 1
    np.testing.assert_allclose((top + bottom) / 2, row / scale + 0.5, atol=0.51)


def test_checkpoint_and_exported_file_think_alike(deployment, episode, tmp_path):
    module = policy(deployment)
    acting.export(module, tmp_path / "policy.pt2")
    one, other = prediction(module, episode, tmp_path), predictions.load_exported(tmp_path / "policy.pt2")(episode)
    assert np.ptp(one.actions[:, 1:], axis=0).min() > 0
    np.testing.assert_allclose(one.actions / SCALE, other.actions / SCALE, atol=1e-4)
    assert other.crop is None  # the file does not tell


def test_the_file_of_a_policy_says_what_it_was_made_for(deployment, tmp_path):
    acting.export(policy(deployment), tmp_path / "policy.pt2")
    _, facts = read(tmp_path / "policy.pt2", exported_policy.FACTS)
    assert json.loads(facts) == {"depth_scale": 1e-4, "camera": "front", "wrench_hz": pytest.approx(500)}


def test_a_long_episode_is_predicted_in_pieces(deployment, episode):
    module = policy(deployment)
    whole, pieces = (of_module(module, "policy", at_once)(episode) for at_once in (len(episode) + 1, 3))
    np.testing.assert_allclose(whole.actions, pieces.actions, atol=1e-6)
    np.testing.assert_array_equal(whole.crop, pieces.crop)


def test_a_blind_policy_shows_no_picture(deployment, episode, tmp_path):
    found = prediction(policy(deployment, encoder="fp"), episode, tmp_path)
    assert (found.camera, found.seen, found.crop) == ("", None, None)
    assert found.actions.shape == (7, 5)


def test_an_episode_that_a_policy_cannot_look_at_is_one_line(deployment, episode, tmp_path):
    with pytest.raises(DatasetError, match=r"19 x 19 px.* front .*24 x 24"):
        prediction(policy(deployment), make_episode(size=24), tmp_path)
    elsewhere = policy(replace(deployment, camera="top"))
    with pytest.raises(DatasetError, match=r"camera top .*front"):
        prediction(elsewhere, episode, tmp_path)


def test_a_classifier_gives_shares_of_the_directions(tmp_path):
    module, _ = untrained(centering_samples(8, seed=0), encoder="vf", group="none", image_size=16)
    found = predictions.load(write_checkpoint(module, tmp_path / "centering.ckpt"))(make_episode(steps=3, size=19))
    np.testing.assert_allclose(found.probabilities.sum(axis=1), 1, atol=1e-6)
    assert (found.seen.shape, found.actions) == ((4, 16, 16, 3), None)


def test_a_file_of_neither_kind_is_one_line(tmp_path):
    torch.save({"svfl": {"format": "svfl-latent", "format_version": "1.0"}}, tmp_path / "latent.ckpt")
    with pytest.raises(FormatError, match=r"latent\.ckpt.* svfl-latent"):
        predictions.load(tmp_path / "latent.ckpt")
