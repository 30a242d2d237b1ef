"""``svfl-collect replay``: exact for everything that the simulation recorded, and not for what was changed."""

from dataclasses import replace

import numpy as np
import pytest

from collectors.centering import CenteringCollector
from collectors.expert import ExpertCollector
from collectors.replay import from_json, replay
from collectors.simulation.config import WorldConfig
from collectors.simulation.noise import NoiseConfig
from collectors.tasks import TASKS
from svfl_data.dataset import Dataset
from svfl_data.episode import Episode
from svfl_data.errors import DatasetError, FormatError
from svfl_data.merge import merge
from svfl_data.store import episode_bytes, read_episode, write_episode
from tests.builders import make_episode
from tests.collectors.conftest import SMALL
from tests.collectors.test_collect_command import collect

pytestmark = pytest.mark.slow


def stored(episode: Episode, tmp_path) -> Episode:
    write_episode(episode, tmp_path / "episode_000000.hdf5")
    return read_episode(tmp_path / "episode_000000.hdf5")


@pytest.mark.parametrize("task", TASKS)
def test_every_task_is_replayed_exactly(task, tmp_path):
    world = WorldConfig(cameras=SMALL.cameras, noise=NoiseConfig.none())
    collector = ExpertCollector(3, task, world=world)
    found = replay(stored(collector(2), tmp_path))
    collector.opened.close()
    assert found.exact, found
    assert found.versions == {}
    assert {"streams/wrench/wrench", "cameras/front/depth", "observations/proprio"} <= found.differences.keys()


def test_centering_is_replayed_exactly(tmp_path):
    collector = CenteringCollector(seed=5, world=SMALL)
    assert replay(stored(collector(1), tmp_path)).exact
    collector.opened.close()


def test_a_change_is_found_where_it_is(picked):
    episode = Dataset.open(picked).read(0)
    arrays = {path: array.copy() for path, array in episode.arrays.items()}
    arrays["streams/wrench/wrench"][70, 2] += 0.5
    arrays["cameras/front/color"][1, 3, 3, 0] ^= 1
    found = replay(Episode(episode.meta, arrays))
    assert not found.exact
    assert {path for path, value in found.differences.items() if value} == {
        "streams/wrench/wrench",
        "cameras/front/color",
    }
    np.testing.assert_allclose(found.differences["streams/wrench/wrench"], 0.5, rtol=1e-5)


def test_another_seed_is_another_scene(picked):
    episode = Dataset.open(picked).read(0)
    found = replay(Episode(replace(episode.meta, seed=9), episode.arrays))
    assert not found.scene
    assert found.differences["streams/object/pose"] > 0.001


def test_other_versions_are_named(picked):
    episode = Dataset.open(picked).read(0)
    found = replay(
        Episode(replace(episode.meta, software=episode.meta.software | {"pybullet": "3.2.6"}), episode.arrays)
    )
    assert found.versions == {"pybullet": ("3.2.6", "3.2.7")}


def test_merged_episodes_keep_what_they_were_made_with(picked, tmp_path):
    merge([Dataset.open(picked)], tmp_path / "merged")
    assert replay(Dataset.open(tmp_path / "merged").read(1)).exact


def test_what_is_not_from_the_simulation_is_refused():
    with pytest.raises(DatasetError, match="not recorded in this simulation"):
        replay(make_episode())


def test_a_configuration_of_another_software_is_refused(picked):
    with pytest.raises(FormatError, match=r"config.world.noise: this software does not know hum"):
        from_json(WorldConfig, {"noise": {"hum": 1.0}}, "config.world")
    assert from_json(WorldConfig, Dataset.open(picked).info["config"]["world"], "config.world") == SMALL


def test_the_command_says_exact_or_what_differs(picked, tmp_path):
    done = collect("replay", picked, "--episode", 1)
    assert done.returncode == 0, done.stderr
    assert "streams/wrench/wrench [N, N, N, N m, N m, N m]" in done.stdout
    assert "episode_000001.hdf5: exact" in done.stdout

    episode = Dataset.open(picked).read(1)
    arrays = {path: array.copy() for path, array in episode.arrays.items()}
    arrays["observations/proprio"][3, 1] += 0.25
    (tmp_path / "e.hdf5").write_bytes(episode_bytes(Episode(episode.meta, arrays)))
    done = collect("replay", tmp_path / "e.hdf5")
    assert done.returncode == 1
    assert "differs when simulated again: observations/proprio by 0.25" in done.stderr
    assert done.stderr.count("\n") == 1

    done = collect("replay", picked, "--episode", 7)
    assert done.returncode == 1
    assert "no episode 7; it has 3 episodes, 0 to 2" in done.stderr
