"""``svfl-collect replay``: exact for everything that the simulation recorded, and not for what was changed."""

import json
import re
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from collectors.simulation.config import WorldConfig
from collectors.simulation.noise import NoiseConfig
from collectors.sources.centering import CenteringCollector
from collectors.sources.expert import ExpertCollector
from collectors.sources.replay import from_json, replay
from collectors.tasks import TASKS
from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import CollectError, DatasetError, FormatError, SvflError
from svfl_data.maintenance.merge import merge
from svfl_data.schema.episode import Episode
from svfl_data.storage.store import episode_bytes, read_episode, write_episode
from tests.helpers.builders import make_episode
from tests.helpers.collecting import collect
from tests.helpers.collectors import SMALL

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
    with pytest.raises(FormatError, match=r"config\.world\.noise: .*\bhum\b"):
        from_json(WorldConfig, {"noise": {"hum": 1.0}}, "config.world")
    assert from_json(WorldConfig, Dataset.open(picked).info["config"]["world"], "config.world") == SMALL


JUNK = st.one_of(
    st.none(),
    st.booleans(),
    st.floats(allow_nan=True, allow_infinity=True),
    st.integers(-(2**70), 2**70),
    st.sampled_from([0, -1, 1e-300, 1e300, 10**400, "", "x", "\x1b[2J", [], {}, [[]], {"": 1}, {"\n": {}}]),
    st.recursive(st.integers(), lambda inside: st.lists(inside, max_size=3) | st.dictionaries(st.text(), inside)),
)


def places(value: object, path: tuple = ()) -> list[tuple]:
    """Path of every value inside JSON values, the outermost too."""
    inside = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [path, *(place for key, member in inside for place in places(member, (*path, key)))]


def changed(config: dict, path: tuple, junk: object) -> dict:
    """A configuration with something else in one place; without it, if `junk` is `...`."""
    config = json.loads(json.dumps(config))
    *way, last = path
    holder = config
    for key in way:
        holder = holder[key]
    if junk is ... and isinstance(holder, dict):
        del holder[last]
    else:
        holder[last] = None if junk is ... else junk
    return config


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_a_strange_configuration_is_replayed_or_refused_in_words(picked, centered, data):
    """Whatever stands where the world, the scene, the attempt or the history was: an answer, or one error of ours."""
    episode = data.draw(st.sampled_from([Dataset.open(picked).read(0), centered]))
    asked = {name: episode.meta.config[name] for name in ("world", "attempt", "scene") if name in episode.meta.config}
    path = data.draw(st.sampled_from([place for place in places(asked) if place]))
    config = episode.meta.config | changed(asked, path, data.draw(st.just(...) | JUNK))
    strange = Episode(
        replace(episode.meta, config=config, history=data.draw(st.just([]) | st.lists(JUNK))), episode.arrays
    )
    with suppress(SvflError):
        replay(strange)


@pytest.fixture(scope="module")
def centered() -> Episode:
    collector = CenteringCollector(seed=5, world=SMALL)
    episode = collector(1)
    collector.opened.close()
    return episode


@pytest.mark.parametrize(
    ("change", "facts"),
    [
        ({"world": []}, r"config\.world: .*`object`.*`array`"),
        ({"world": {"physics_steps": 10**9}}, "`int` <= 1000"),
        ({"world": {"physics_steps": 1000}}, r"\d readings .*\d"),
        ({"world": {"cameras": {"front": {"height": 4000, "width": 4000}}}}, r"config\.world .*4000.*16"),
        (
            {"world": {"cameras": {"front": {"tilt": 1}}}},
            r"config\.world\.cameras\.front: .*\btilt\b",
        ),
        (
            {"world": {"blend_steps": 10}},
            r"config\.world: .*\bblend_steps\b",
        ),
        ({"world": {"admittance": {"mass": -1.0}}}, r"admittance\.mass"),
        ({"world": {"robot": {"name": "abacus"}}}, r"config\.world: no robot 'abacus'; .*panda_sim"),
        ({"world": {"robot": {"friction": 1.0}}}, r"config\.world: .*robot.*name"),
        ({"world": {"robot": {"name": "panda_sim", "friction": -1.0}}}, r"config\.world: .*>= 0"),
        ({"world": {"robot": {"name": "panda_sim", "wheels": 2}}}, r"config\.world\.robot: .*wheels"),
        ({"world": {"home": [0.55, 0.0]}}, "length 3"),
        ({"world": {"workspace": [[0.55, 0.35], [-0.2, 0.2], [-0.01, 0.25]]}}, r"workspace .*0\.55, 0\.35"),
        ({"attempt": -1}, r"config: .*`int` >= 0 .*attempt"),
        ({"attempt": "first"}, "config: .*`int`.*`str`"),
        ({"index": [0]}, r"config: .*`int \| null`.*`array`"),
    ],
)
def test_a_strange_configuration_is_named(picked, change, facts):
    episode = Dataset.open(picked).read(0)
    world = change.get("world", {})
    config = episode.meta.config | change
    if isinstance(world, dict):
        config["world"] = episode.meta.config["world"] | world
    with pytest.raises(FormatError, match=facts):
        replay(Episode(replace(episode.meta, config=config), episode.arrays))


def test_a_configuration_from_before_robots_had_names_is_read(picked):
    episode = Dataset.open(picked).read(0)
    world = dict(episode.meta.config["world"])
    world["panda"] = {key: value for key, value in world.pop("robot").items() if key != "name"}
    meta = replace(episode.meta, config=episode.meta.config | {"world": world})
    assert replay(Episode(meta, episode.arrays)).exact


@pytest.mark.parametrize("task", ["block_pushing", "block_pulling"])
def test_a_scene_without_room_is_refused(picked, task):
    """A workspace in which nothing is far enough apart: an end, not a search for ever."""
    episode = Dataset.open(picked).read(0)
    narrow = episode.meta.config["world"] | {"workspace": [[0.45, 0.65], [-0.1, 0.1], [-0.01, 0.25]]}
    meta = replace(episode.meta, task=task, config=episode.meta.config | {"world": narrow})
    with pytest.raises(CollectError, match=r"two places [\d.]+ m apart"):
        replay(Episode(meta, episode.arrays))


def test_an_unstable_arm_is_one_line(picked):
    episode = Dataset.open(picked).read(0)
    servo = {"robot": {"name": "panda_sim", "servo": {"bandwidth": 1e9, "damping_ratio": 0.0}}}
    meta = replace(episode.meta, config=episode.meta.config | {"world": episode.meta.config["world"] | servo})
    with pytest.raises(CollectError, match="unstable"):
        replay(Episode(meta, episode.arrays))


def test_a_strange_configuration_is_one_line_of_the_command(picked, tmp_path):
    episode = Dataset.open(picked).read(1)
    meta = replace(episode.meta, config=episode.meta.config | {"world": {"noise": "\x1b[2J"}})
    (tmp_path / "e.hdf5").write_bytes(episode_bytes(Episode(meta, episode.arrays)))
    done = collect("replay", tmp_path / "e.hdf5")
    assert (done.returncode, done.stderr.count("\n")) == (1, 1)
    assert done.stderr.startswith("svfl-collect: ")
    assert "config.world" in done.stderr


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
    assert "observations/proprio by 0.25" in done.stderr
    assert done.stderr.count("\n") == 1

    done = collect("replay", picked, "--episode", 7)
    assert done.returncode == 1
    assert re.search("episode 7.* 3 episodes, 0 to 2", done.stderr)
