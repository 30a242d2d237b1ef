"""``svfl-collect expert --tags``: tags tell success as the truth does, and a policy sees nothing of it."""

import re
from dataclasses import replace

import cv2
import numpy as np
import pytest

from collectors.apriltags.watch import MAX_AGE
from collectors.simulation import CameraConfig, WorldConfig
from collectors.simulation.bodies import quat_from_yaw
from collectors.simulation.bullet import pybullet
from collectors.sources.expert import ExpertCollector
from collectors.sources.tagged_expert import TAG_CAMERAS, TaggedCollector
from collectors.tasks import block_picking, block_pushing
from svfl_data.checks import check_episode
from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import CollectError, UsageError
from svfl_data.storage.store import episode_bytes
from tests.helpers.collecting import collect
from tests.helpers.collectors import SMALL

pytestmark = pytest.mark.slow


def recorded(collector, *indices):
    """Episodes of a collector, whose world is closed then."""
    episodes = [collector(index) for index in indices]
    collector.opened.close()
    return episodes


@pytest.fixture(scope="module")
def picked():
    return recorded(TaggedCollector(0, "block_picking", world=SMALL), 0, 1)


@pytest.fixture(scope="module")
def pushed():
    return recorded(TaggedCollector(0, "block_pushing", perturbations=0.1, world=SMALL), 0)


def told(episode):
    """What the tags said at each observation, from the stream alone."""
    drawn, arrays = episode.meta.config["drawn"], episode.arrays
    poses, half = arrays["streams/tags/pose"], drawn["half"]
    if episode.meta.task == "block_picking":
        success = poses[:, 2] > half + block_picking.LIFTED
    else:
        far = np.linalg.norm(poses[:, :2] - drawn["goal"], axis=1)
        success = (far < block_pushing.REACHED) & (poses[:, 2] < half + 2 * block_pushing.LYING)
    at = dict(zip(arrays["streams/tags/t_ns"], success & (arrays["streams/tags/age"] <= MAX_AGE), strict=True))
    return np.array([at.get(t_ns, False) for t_ns in episode.t_ns])


def test_the_reward_from_tags_is_the_true_one(picked, pushed):
    agree = np.concatenate([(told(one) == one.arrays["extra/state/achieved"])[1:] for one in (*picked, *pushed)])
    assert len(agree) > 60
    assert agree.mean() >= 0.99


def test_an_episode_ends_when_the_tags_say_so_and_is_whole(picked, pushed):
    for episode in (*picked, *pushed):
        assert told(episode).tolist() == [False] * len(episode) + [True]
        assert episode.meta.success
        assert check_episode(episode) == []
        age, seen = episode.tags_age, episode.tags_age == 0.0
        assert seen.mean() > 0.9
        older = np.diff(age) - np.diff(episode.tags_t_ns) / 1e9  # of a pose that stays
        assert np.allclose(older[~seen[1:]], 0.0)
        where = np.linalg.norm(episode.tags_pose[seen, :3] - true_places(episode)[seen], axis=1)
        assert np.median(where) < 0.003
    assert "actions/expert_action" in pushed[0].arrays
    assert pushed[0].meta.config["tag_cameras"].keys() == TAG_CAMERAS.keys()


def true_places(episode):
    """Places of the block at the looks, (Q, 3)."""
    rows = np.searchsorted(episode.object_t_ns, episode.tags_t_ns)
    return episode.object_pose[rows, :3]


def test_the_command_gives_the_same_bytes_with_two_workers_and_other_datasets_are_refused(picked, tmp_path):
    words = ("expert", "--task", "block_picking", "--episodes", 2, "--image-size", 16, "--out", tmp_path)
    done = collect(*words, "--tags", "--workers", 2)
    assert done.returncode == 0, done.stderr
    assert "2 demonstrations of" in done.stdout
    dataset = Dataset.open(tmp_path)
    for index, episode in enumerate(picked):
        assert dataset.episode_path(index).read_bytes() == episode_bytes(episode)
    (tmp_path / "plain").mkdir()
    Dataset.create_or_resume(
        tmp_path / "plain", "block_picking", 0, ExpertCollector(0, "block_picking", world=SMALL).config()
    )
    done = collect(*words[:-1], tmp_path / "plain", "--tags")
    assert done.returncode == 1
    assert re.search(r"config\.tags .*None.* True", done.stderr)


def test_a_policy_sees_tags_on_the_block_and_nothing_else_of_them():
    """Against the same scene with a plain block: the first observation differs in colour, and only on the block."""
    world = WorldConfig(cameras={"front": CameraConfig(height=76, width=76)})
    attempts = []
    for kind in (TaggedCollector, ExpertCollector):
        collector = kind(0, "block_picking", world=world, attempts=1, steps=1)
        with pytest.raises(CollectError, match="none of 1 attempts"):
            collector(0, keep=attempts.append)
        collector.opened.close()
    tagged, plain = attempts
    assert tagged.cameras.keys() == {"front"}
    more = tagged.arrays.keys() - plain.arrays.keys()
    assert all(path.startswith("streams/tags/") for path in more - {"extra/state/achieved"})
    np.testing.assert_array_equal(tagged.proprio[0], plain.proprio[0])
    differs = (tagged.cameras["front"].color[0] != plain.cameras["front"].color[0]).any(axis=-1)
    assert differs.any()
    assert not (differs & ~on_block(tagged)).any()
    depth = [one.cameras["front"].depth_m[0] for one in attempts]
    assert np.abs(depth[0] - depth[1]).max() < 0.001


def on_block(episode):
    """The pixels of the block, and one around them, (H, W)."""
    drawn, camera = episode.meta.config["drawn"], episode.cameras["front"]
    half = drawn["half"]
    R = np.reshape(pybullet.getMatrixFromQuaternion(quat_from_yaw(drawn["yaw"])), (3, 3))
    corners = half * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    points = corners @ R.T + [*drawn["xy"], half]
    T = np.linalg.inv(camera.T_base_camera)
    seen = (points @ T[:3, :3].T + T[:3, 3]) @ camera.intrinsics.T
    hull = cv2.convexHull(np.round(seen[:, :2] / seen[:, 2:]).astype(np.int32))
    mask = cv2.fillConvexPoly(np.zeros(camera.color.shape[1:3], np.uint8), hull, 1)
    return cv2.dilate(mask, np.ones((3, 3), np.uint8)).astype(bool)


def test_what_tags_do_not_see_does_not_count():
    """Cameras that look at the sky: the expert lifts the block, and nobody knows."""
    away = {name: replace(one, target=(one.eye[0], one.eye[1], 2.0)) for name, one in TAG_CAMERAS.items()}
    collector, failed = TaggedCollector(0, "block_picking", world=SMALL, attempts=1, tag_cameras=away), []
    with pytest.raises(CollectError, match=r"1 x .*50 steps"):
        collector(0, keep=failed.append)
    collector.opened.close()
    assert failed[0].arrays["extra/state/achieved"].any()
    assert not failed[0].has("tags_pose")


@pytest.mark.parametrize("task", ["block_pulling", "drawer_opening"])
def test_tasks_that_tags_cannot_tell_are_refused_at_once(task):
    with pytest.raises(UsageError, match=f"block_picking and block_pushing.* {task}"):
        TaggedCollector(0, task)


def test_the_command_refuses_them_in_one_line(tmp_path):
    done = collect("expert", "--task", "all", "--tags", "--out", tmp_path / "x")
    assert done.returncode == 2
    assert re.search("block_picking and block_pushing.* block_pulling", done.stderr)
    assert done.stderr.count("\n") == 1
    assert not (tmp_path / "x").exists()
