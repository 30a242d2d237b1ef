"""Block-centering samples are what they say: one finger on the block, and a label that mends the grasp."""

from dataclasses import replace

import numpy as np
import pytest

from collectors.recording.loop import record
from collectors.simulation import NoiseConfig
from collectors.simulation.centering import CenteringConfig, Scene, draw_scene
from collectors.simulation.centering_expert import CollisionExpert
from collectors.simulation.config import WorldConfig
from collectors.simulation.world import World
from collectors.sources.centering import CenteringCollector, add_block, balanced_direction
from collectors.tasks.task import MAX_STEPS
from svfl_data.errors import CollectError
from svfl_data.sampling.windows import latest
from svfl_data.schema.episode import Episode
from svfl_data.storage.store import episode_bytes
from svfl_data.symmetry import OFFSET_PARTS, WRENCH_PARTS, act, border_distance, element, nearest_direction

pytestmark = pytest.mark.slow

SAMPLES = 8


@pytest.fixture(scope="module")
def episodes():
    collector = CenteringCollector(seed=5)
    return [collector(index) for index in range(SAMPLES)]


def first_readings(episode: Episode) -> int:
    """Readings up to the first observation."""
    return latest(episode.wrench_t_ns, episode.t_ns[0]) + 1


def test_the_same_sample_is_the_same_bytes(episodes):
    """In any order, in a collector of its own."""
    for index in (3, 1):
        assert episode_bytes(CenteringCollector(seed=5)(index)) == episode_bytes(episodes[index])
    assert episode_bytes(CenteringCollector(seed=6)(1)) != episode_bytes(episodes[1])


def test_classes_are_balanced():
    for start in range(0, 200, 4):
        assert sorted(balanced_direction(7, index) for index in range(start, start + 4)) == [0, 1, 2, 3]
    assert len({tuple(balanced_direction(7, i) for i in range(s, s + 4)) for s in range(0, 200, 4)}) > 8


def test_the_label_is_the_true_offset(episodes):
    for episode in episodes:
        truth = episode.object_pose[-1, :2] - episode.proprio[-1, 1:3]
        np.testing.assert_allclose(episode.label_offset, truth, atol=1e-6)
        in_image = act(episode.cameras["front"].image_axes, episode.label_offset, OFFSET_PARTS)
        assert int(episode.label_direction) == int(nearest_direction(in_image))
        assert np.rad2deg(border_distance(in_image)) >= 5


def test_the_wrist_feels_the_collision_only_after_it(episodes):
    """Free until the last steps, then an upward force whose lever arm is the finger that touches."""
    for episode in episodes:
        wrench = episode.tared_wrench
        force = np.linalg.norm(wrench[:, :3], axis=1)
        assert force[: int(first_readings(episode))].max() < 2.0
        final = wrench[-5:].mean(axis=0)
        assert 3.0 < final[2] < 60.0
        lever = np.array([-final[4], final[3]]) / final[2]
        along = lever @ episode.label_offset / np.linalg.norm(episode.label_offset)
        assert 0.03 < along < 0.065


def test_an_episode_starts_at_home_with_enough_readings(episodes):
    for episode in episodes:
        assert first_readings(episode) >= 64
        assert len(episode) <= MAX_STEPS
        assert np.all(np.diff(episode.wrench_t_ns) == 2_000_000)
        assert np.all(np.diff(episode.t_ns) == 50_000_000)
        np.testing.assert_allclose(episode.proprio[0], [1, *episode.meta.config["world"]["home"], 0], atol=2e-3)
        assert np.abs(episode.action[:, 1:4]).max() <= 0.025 + 1e-7
        assert np.abs(episode.action[:, 4]).max() <= np.pi / 16 + 1e-7


def test_images_show_the_scene(episodes):
    """The block is where the camera's calibration says, and its colour is seen there or the gripper hides it."""
    for episode in episodes:
        camera = episode.cameras["front"]
        point = np.linalg.inv(camera.T_base_camera) @ [*episode.object_pose[0, :3], 1]
        column, row, _ = (camera.intrinsics @ (point[:3] / point[2])).round().astype(int)
        drawn = np.array(episode.meta.config["drawn"]["block_color"])
        seen = camera.color[0, row - 1 : row + 2, column - 1 : column + 2].mean(axis=(0, 1))
        assert np.dot(drawn, seen) / (np.linalg.norm(drawn) * np.linalg.norm(seen)) > 0.98
        assert abs(camera.depth_m[0, row, column] - point[2]) < 0.05


@pytest.mark.parametrize("direction", range(4))
def test_scenes_are_drawn_in_the_wanted_direction(direction):
    with World() as world:
        for seed in range(50):
            scene = draw_scene(np.random.default_rng(seed), direction, CenteringConfig(border_deg=5), world)
            offset = np.subtract(scene.block_xy, scene.gripper_xy)
            in_image = world.camera.image_axes @ offset
            assert nearest_direction(in_image) == direction
            assert np.rad2deg(border_distance(in_image)) >= 5 - 1e-9
            assert -np.pi / 2 <= scene.gripper_yaw <= np.pi / 2


def beside(scene: Scene) -> Scene:
    """The same scene with the gripper coming down far from the block."""
    away = np.where(np.asarray(scene.block_xy) > WorldConfig().home[:2], -0.15, 0.15)
    return replace(scene, gripper_xy=tuple(np.add(scene.gripper_xy, away)))


def test_attempts_that_miss_are_retried_and_counted(monkeypatch):
    grippers = iter([beside, lambda scene: scene])
    monkeypatch.setattr("collectors.sources.centering.draw_scene", lambda *args: next(grippers)(draw_scene(*args)))
    episode = CenteringCollector(seed=5)(0)
    assert episode.meta.config["rejected"] == ["0 fingers touched"]
    assert episode.meta.config["attempt"] == 1


def test_a_sample_that_never_collides_is_an_error(monkeypatch):
    monkeypatch.setattr("collectors.sources.centering.draw_scene", lambda *args: beside(draw_scene(*args)))
    with pytest.raises(CollectError, match=r"sample 0 \(seed 5\): .*\b2 attempts .*0 fingers"):
        CenteringCollector(seed=5, attempts=2)(0)


def collide(world: World, scene: Scene) -> np.ndarray:
    """Tared wrench at the end of a collision, mean of the last 10 ms, base axes."""
    world.reset(seed=0)
    add_block(world, scene)
    world.tare()
    record(world, CollisionExpert(scene, touchdown=2 * scene.block_half + world.fingers.tip), MAX_STEPS)
    return world.wrench[-5:].mean(axis=0) - world.tare_offset


@pytest.mark.parametrize("seed", range(3))
def test_a_mirrored_collision_feels_mirrored(seed):
    """Gripper and block are their own mirror images; a collision mirrored at the plane y = 0 is felt mirrored."""
    mirror = element(0, flip=True)
    with World(WorldConfig(noise=NoiseConfig.none())) as world:
        scene = draw_scene(np.random.default_rng(seed), seed, CenteringConfig(), world)
        (bx, by), (hx, hy) = scene.block_xy, scene.gripper_xy
        flipped = replace(
            scene, block_xy=(bx, -by), gripper_xy=(hx, -hy), block_yaw=-scene.block_yaw, gripper_yaw=-scene.gripper_yaw
        )
        felt, felt_flipped = collide(world, scene), collide(world, flipped)
    expected = act(mirror, felt, WRENCH_PARTS)
    assert np.linalg.norm(felt_flipped[:3] - expected[:3]) < 0.05 * np.linalg.norm(felt[:3])
    assert np.linalg.norm(felt_flipped[3:] - expected[3:]) < 0.05 * np.linalg.norm(felt[3:])


def test_a_block_rests_on_the_table():
    scene = Scene((0.6, 0.05), 0.025, 0.3, 0.1, 0.5, (0.2, 0.4, 0.6), (0.6, 0.05), 0.3, 0.01)
    with World() as world:
        world.reset(seed=0)
        block = add_block(world, scene)
        for _ in range(10):
            world.step(np.array([1.0, 0, 0, 0, 0]))
        np.testing.assert_allclose(world.pose(block)[:3], [0.6, 0.05, 0.025], atol=1e-3)
