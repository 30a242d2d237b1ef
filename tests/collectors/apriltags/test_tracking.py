"""A tagged block is where its tags say, a lost one is said to be lost, and success never rests on an old pose."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from collectors.apriltags.tracker import Limits, Tracker, quat_from_matrix
from collectors.apriltags.watch import MAX_AGE, Lifted, Reached, Watch
from collectors.recording.loop import record
from collectors.simulation.bodies import quat_from_yaw
from collectors.simulation.bullet import pybullet
from collectors.simulation.camera import calibration as calibration_of
from collectors.simulation.world import World
from collectors.sources.tagged_block import wear_tags
from collectors.sources.tagged_expert import TAG_CAMERAS, SimulatedTagCamera, watched
from collectors.tasks import task_class
from collectors.tasks.task import attempt_seed
from svfl_data.errors import CollectError, UsageError
from svfl_data.schema.episode import Episode, Meta
from svfl_data.storage.store import read_episode, write_episode
from tests.helpers.collectors import SMALL

pytestmark = pytest.mark.slow

HALF = 0.025
VGA = replace(TAG_CAMERAS["tags_left"], height=480, width=640, fov_deg=45.0)
STEP_NS = 50_000_000


class Scene:
    """A tagged block and one camera at 0.6 m, in a world whose arm is at home, out of the picture."""

    def __init__(self):
        self.world = World(SMALL)
        self.world.reset(seed=0)
        cube = self.world.add_box((HALF, HALF, HALF), (0.55, 0.0, HALF), 0.0, 0.1, 0.5)
        self.body, self.layout = wear_tags(self.world.client, cube, HALF)
        self.camera = SimulatedTagCamera(self.world, replace(VGA, height=960, width=1280))
        self.calibration = calibration_of(VGA)

    def put(self, x, y, yaw, z=HALF):
        pybullet.resetBasePositionAndOrientation(
            self.body, (x, y, z), quat_from_yaw(yaw), physicsClientId=self.world.client
        )

    def picture(self, noise=3.0, seed=0):
        clean = cv2.resize(self.camera()[1], (640, 480), interpolation=cv2.INTER_AREA)  # optics make no jagged edges
        noisy = clean + np.random.default_rng(seed).normal(0, noise, clean.shape)
        return np.clip(noisy, 0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def scene():
    scene = Scene()
    yield scene
    scene.world.close()


def wrap(angle):
    return (angle + np.pi) % (2 * np.pi) - np.pi


def yaw_of(pose):
    x, y, z, w = pose[3:]
    return np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


@pytest.mark.parametrize(("x", "y", "yaw", "upright"), [(0.55, 0.0, 0.3, True), (0.6, -0.06, -2.0, False)])
def test_place_and_yaw_under_noise_and_behind_a_finger(scene, x, y, yaw, upright):
    scene.put(x, y, yaw)
    seen_by = scene.calibration
    picture = scene.picture()
    hidden = picture.copy()
    point = seen_by.intrinsics @ (np.linalg.inv(seen_by.T_base_camera) @ [x, y, 0.0, 1.0])[:3]
    column, row = (int(part) for part in point[:2] / point[2])
    hidden[row + 8 : row + 60, column - 60 : column + 60] = (70, 70, 75)  # the lower part of both side faces
    for seen in (picture, hidden):
        track = Tracker(scene.layout, upright).see(seen, 0, seen_by)
        assert np.linalg.norm(track.pose[:3] - [x, y, HALF]) < 0.003
        assert abs(wrap(yaw_of(track.pose) - yaw)) < np.radians(2.0)
        assert track.age == 0.0
        assert track.error < 1.0


def test_a_lost_object_keeps_its_pose_and_grows_old(scene):
    scene.put(0.55, 0.0, 0.3)
    tracker, calibration = Tracker(scene.layout, upright=True), scene.calibration
    empty = np.full((480, 640, 3), 150, np.uint8)
    assert tracker.see(empty, 0, calibration) is None
    assert tracker.arrays() == {}
    seen = tracker.see(scene.picture(), STEP_NS, calibration)
    for number in (2, 3, 4):
        lost = tracker.see(empty, number * STEP_NS, calibration)
        assert np.array_equal(lost.pose, seen.pose)
        assert lost.age == pytest.approx(0.05 * (number - 1))
    assert tracker.refused["no tag"] == 4
    stream = tracker.arrays()
    assert stream["streams/tags/t_ns"].tolist() == [number * STEP_NS for number in (1, 2, 3, 4)]
    assert np.allclose(stream["streams/tags/age"], [0, 0.05, 0.1, 0.15])
    again = tracker.see(scene.picture(seed=1), 5 * STEP_NS, calibration)
    assert again.age == 0.0


def test_a_picture_that_comes_late_tells_nothing_and_time_goes_on(scene):
    tracker, calibration = Tracker(scene.layout), scene.calibration
    scene.put(0.5, 0.0, 0.3)
    early = scene.picture()
    scene.put(0.6, 0.0, 0.3)
    seen = tracker.see(scene.picture(), 3 * STEP_NS, calibration)
    late = tracker.see(early, STEP_NS, calibration)
    assert np.array_equal(late.pose, seen.pose)
    empty = np.full((480, 640, 3), 150, np.uint8)
    assert tracker.see(empty, 5 * STEP_NS, calibration).age == pytest.approx(0.1)
    between = tracker.see(early, 4 * STEP_NS, calibration)  # of another camera, that has seen it since
    assert abs(between.pose[0] - 0.5) < 0.003
    assert between.age == pytest.approx(0.05)
    stream = tracker.arrays()
    assert stream["streams/tags/t_ns"].tolist() == [3 * STEP_NS, 5 * STEP_NS]
    assert (stream["streams/tags/age"] >= 0).all()


def test_doubtful_sightings_are_refused(scene):
    scene.put(0.55, 0.0, 0.3)
    picture, calibration = scene.picture(), scene.calibration
    faint = Tracker(scene.layout, limits=Limits(margin=1000.0))
    assert faint.see(picture, 0, calibration) is None
    assert faint.refused == {"unclear": 1}
    strict = Tracker(scene.layout, limits=Limits(share=1.01))
    assert strict.see(picture, 0, calibration) is None
    assert strict.refused == {"edges": 1}


@pytest.mark.parametrize("upright", [False, True])
def test_a_block_of_which_a_third_is_hidden_is_where_it_is_said_to_be_or_not_seen(scene, upright):
    rng, radius = np.random.default_rng(4), HALF * np.sqrt(3)
    seen_by, inverse = scene.calibration, np.linalg.inv(scene.calibration.T_base_camera)
    seen = 0
    for number in range(16):
        x, y, yaw = rng.uniform(0.5, 0.6), rng.uniform(-0.05, 0.05), rng.uniform(-np.pi, np.pi)
        scene.put(x, y, yaw)
        picture = scene.picture(seed=number)
        u, v, depth = seen_by.intrinsics @ (inverse @ [x, y, HALF, 1.0])[:3]
        reach = radius * seen_by.intrinsics[0, 0] / depth
        edge = int(u / depth + 0.3 * reach)  # of a finger that comes from the right, or from the left
        columns = slice(edge, edge + 200) if number % 2 else slice(0, int(u / depth - 0.3 * reach))
        picture[int(v / depth - 2 * reach) : int(v / depth + 2 * reach), columns] = (70, 70, 75)
        track = Tracker(scene.layout, upright).see(picture, 0, seen_by)
        if track is not None:
            seen += 1
            assert np.linalg.norm(track.pose[:3] - [x, y, HALF]) < 0.003
            assert abs(wrap(yaw_of(track.pose) - yaw)) < np.radians(2.0)
    assert seen >= 3


class Given:
    """A camera that shows given pictures, one after the other, then the last one again."""

    def __init__(self, calibration, pictures):
        self.calibration, self.pictures, self.asked = calibration, pictures, -1

    def __call__(self):
        self.asked += 1
        return self.asked * STEP_NS, self.pictures[min(self.asked, len(self.pictures) - 1)]


def test_success_never_rests_on_an_old_pose(scene):
    scene.put(0.6, 0.05, 0.0)
    empty = np.full((480, 640, 3), 150, np.uint8)
    camera = Given(scene.calibration, [scene.picture(), *[empty] * 10])
    watch = Watch(Tracker(scene.layout), {"one": camera}, Reached((0.6, 0.05), 0.05, 0.04))
    told = [watch.achieved, *(watch.done() for _ in range(6))]
    fresh = round(MAX_AGE / 0.05)
    assert told == [True] * (fresh + 1) + [False] * (6 - fresh)
    with pytest.raises(CollectError, match=r"tags 0, 1\b.* [\d.]+ s ago"):
        watch.reset_pose()


def test_the_last_picture_of_a_camera_that_hangs_is_not_one_of_now(scene):
    scene.put(0.6, 0.05, 0.0)
    picture, clock = scene.picture(), iter(range(0, 10**12, STEP_NS))

    class Hangs:
        calibration = scene.calibration

        def __call__(self):
            return 0, picture

    goal = Reached((0.6, 0.05), 0.05, 0.04)
    watch = Watch(Tracker(scene.layout), {"one": Hangs()}, goal, now=lambda: next(clock))
    told = [watch.achieved, *(watch.done() for _ in range(5))]
    assert told == [True] * 4 + [False] * 2  # 0, 0.05, 0.1, 0.15 s, then too old
    with pytest.raises(CollectError, match=r"\b1\.2 s ago"):
        watch.reset_pose()


def test_a_reset_gets_a_pose_of_now(scene):
    scene.put(0.5, 0.05, 0.4)
    camera = Given(scene.calibration, [np.full((480, 640, 3), 150, np.uint8), scene.picture()])
    watch = Watch(Tracker(scene.layout, upright=True), {"one": camera}, Lifted(0.1))
    assert not watch.achieved
    assert np.linalg.norm(watch.reset_pose()[:3] - [0.5, 0.05, HALF]) < 0.003


@pytest.mark.parametrize("name", ["block_pushing", "block_picking"])
def test_an_episode_with_tags(tmp_path, name):
    with World(SMALL) as world:
        task = task_class(name).begin(world, attempt_seed(0, 0, 0))
        before = pybullet.getDynamicsInfo(task.body, -1, physicsClientId=world.client)[:2]
        watch = watched(task)
        after = pybullet.getDynamicsInfo(task.body, -1, physicsClientId=world.client)[:2]
        assert after == before  # mass and friction
        seen = []

        def policy(observation):
            seen.append(observation)
            return np.array([1.0, 0.0, 0.0, 0.0, 0.0], np.float32)

        arrays = record(world, policy, 2, watch.done, task.state) | watch.tracker.arrays()
    assert all(set(one.frames) == {"front"} for one in seen)  # no policy sees the tag cameras
    assert not watch.achieved
    file = tmp_path / "episode_000000.hdf5"
    write_episode(Episode(Meta(name, 0, 0, "expert", False), arrays), file)
    episode = read_episode(file)
    assert len(episode.tags_pose) == len(episode.t_ns) == 3
    assert (
        np.linalg.norm(episode.tags_pose[:, :3] - episode.object_pose[:, :3], axis=1).max() < 0.015
    )  # small pictures from 0.7 m
    assert set(episode.tags_count) <= {1, 2, 3}


def test_tasks_without_a_block_are_refused():
    with World(SMALL) as world:
        task = task_class("drawer_closing").begin(world, attempt_seed(0, 0, 0))
        with pytest.raises(UsageError, match="DrawerClosing"):
            watched(task)


def test_quaternions():
    for vector in ([0, 0, 0], [0.1, -0.4, 0.2], [np.pi - 1e-3, 0, 0]):
        R = cv2.Rodrigues(np.array(vector, float))[0]
        assert np.allclose(np.reshape(pybullet.getMatrixFromQuaternion(quat_from_matrix(R)), (3, 3)), R)
