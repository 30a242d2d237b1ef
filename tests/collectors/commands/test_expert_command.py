"""``svfl-collect expert``: demonstrations only, the same bytes in any order, and failures kept apart."""

import json
import re
from collections.abc import Iterator

import numpy as np
import pytest

from collectors.recording.worker import FAILURES, Worker
from collectors.simulation.camera import CAMERAS, CameraConfig
from collectors.simulation.world import World
from collectors.sources.expert import ExpertCollector
from collectors.tasks import PAPER
from collectors.tasks.block_picking import BlockPicking
from collectors.tasks.task import ATTEMPTS
from svfl_data.checks import check_episode
from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import CollectError
from svfl_data.storage.store import episode_bytes
from tests.helpers.collecting import collect, contents
from tests.helpers.collectors import SMALL

pytestmark = pytest.mark.slow

ARGUMENTS = ("expert", "--task", "block_picking", "--episodes", 3, "--image-size", 16)


@pytest.fixture
def expert() -> Iterator[ExpertCollector]:
    collector = ExpertCollector(0, "block_picking", world=SMALL)
    yield collector
    collector.opened.close()


@pytest.fixture
def clumsy(monkeypatch):
    """The first two attempts of every episode fail: one at once, one by running out of time."""
    calls = iter(range(10**6))
    act = BlockPicking.expert

    def expert(self, gripper):
        attempt = next(calls)
        if attempt % 3 == 0:
            return gripper.rest(2)
        return gripper.rest(60) if attempt % 3 == 1 else act(self, gripper)

    monkeypatch.setattr(BlockPicking, "expert", expert)


def test_any_order_and_any_number_of_workers_give_the_same_bytes(picked, expert, tmp_path):
    """Against episodes 0, 1, 2 made in this order in one world: another order, and two processes."""
    dataset = Dataset.open(picked)
    for index in (2, 0):
        assert episode_bytes(expert(index)) == dataset.episode_path(index).read_bytes()
    done = collect(*ARGUMENTS, "--workers", 2, "--out", tmp_path / "two")
    assert done.returncode == 0, done.stderr
    assert f"{tmp_path / 'two'}: 3 demonstrations of " in done.stdout
    assert contents(tmp_path / "two") == contents(picked)


def test_a_demonstration_says_what_made_it(picked):
    episode = Dataset.open(picked).read(1)
    meta = episode.meta
    assert (meta.task, meta.index, meta.seed, meta.source, meta.success) == ("block_picking", 1, 0, "expert", True)
    assert {"task", "noise", "perturbations", "world", "drawn", "index", "attempt", "rejected"} == meta.config.keys()
    assert meta.software.keys() == {"svfl", "pybullet", "numpy"}
    assert check_episode(episode) == []
    np.testing.assert_allclose(episode.object_pose[0, :2], meta.config["drawn"]["xy"], atol=1e-4)


def test_failed_attempts_are_never_demonstrations(clumsy, expert):
    episode = expert(0)
    assert episode.meta.success
    assert episode.meta.config["attempt"] == 2
    assert episode.meta.config["rejected"] == ["the expert gave up", "not achieved in 50 steps"]


def test_failures_are_kept_in_a_dataset_of_their_own(clumsy, expert, tmp_path):
    worker = Worker(expert, tmp_path, "block_picking", 0, expert.config(), keep_failures=True)
    collected = worker.collect(1)
    assert collected.attempts == 3
    assert Dataset.open(tmp_path).indices == [1]
    failures = Dataset.open(tmp_path / FAILURES)
    assert failures.indices == [ATTEMPTS, ATTEMPTS + 1]
    assert [episode.meta.success for episode in failures] == [False, False]
    assert set(collected.files) == contents(tmp_path).keys() - {"dataset.json", "failures/dataset.json"}


def test_an_expert_that_never_succeeds_is_an_error(expert, monkeypatch):
    monkeypatch.setattr(BlockPicking, "expert", lambda self, gripper: gripper.rest(1))
    with pytest.raises(CollectError, match=r"episode 4 of block_picking .*\b20 x .*gave up"):
        expert(4)


def test_all_tasks_go_into_a_folder_each_and_are_resumed(tmp_path):
    arguments = ("expert", "--task", "all", "--image-size", 8, "--out", tmp_path, "--workers", 2)
    done = collect(*arguments, "--episodes", 1)
    assert done.returncode == 0, done.stderr
    assert {folder.name for folder in tmp_path.iterdir()} == set(PAPER)
    for name in PAPER:
        assert Dataset.open(tmp_path / name).indices == [0]
        assert json.loads((tmp_path / name / "dataset.json").read_text())["task"] == name
    before = contents(tmp_path)
    done = collect(*arguments, "--episodes", 1)
    assert done.returncode == 0, done.stderr
    assert contents(tmp_path) == before


def test_a_robot_is_chosen_by_name_and_recorded(tmp_path):
    arguments = ("--robot", "ur5e_sim", "--image-size", 8, "--out", tmp_path / "ur5e")
    done = collect("expert", "--task", "block_pushing", "--episodes", 1, *arguments)
    assert done.returncode == 0, done.stderr
    episode = Dataset.open(tmp_path / "ur5e").read(0)
    assert episode.meta.config["world"]["robot"]["name"] == "ur5e_sim"
    assert episode.arrays["streams/joints/position"].shape[1] == 8
    assert check_episode(episode) == []
    done = collect("replay", tmp_path / "ur5e")
    assert done.returncode == 0, done.stderr
    assert "exact" in done.stdout


@pytest.mark.parametrize("name", [name for name, config in CAMERAS.items() if not config.mounted])
def test_every_camera_that_stands_still_sees_the_workspace(name):
    config = CAMERAS[name]
    with World(SMALL.__class__(cameras={name: CameraConfig(**{**vars(config), "height": 100, "width": 100})})) as world:
        calibration = world.camera
        for x in world.workspace[0]:
            for y in world.workspace[1]:
                point = np.linalg.inv(calibration.T_base_camera) @ [x, y, 0, 1]
                pixel = calibration.intrinsics @ (point[:3] / point[2])
                assert (pixel[:2] >= 0).all()
                assert (pixel[:2] <= 99).all()


@pytest.mark.parametrize(
    ("arguments", "facts"),
    [
        (["--task", "juggling"], "--task.* 'juggling'.*block_picking"),
        (["--noise", "2.5"], r"--noise.* '2\.5' .*0 and 2"),
        (["--noise", "nan"], "--noise.* 'nan' .*0 and 2"),
        (["--episodes", "0"], "--episodes.* '0' .*at least 1"),
        (["--workers", "-2"], "--workers.* '-2' .*at least 1"),
        (["--cameras", "front,"], "camera ''.* front, top"),
        (["--executor", "slurm"], "--executor.* 'slurm'"),
    ],
)
def test_wrong_arguments_are_one_line_and_code_2(arguments, facts, tmp_path):
    done = collect("expert", "--task", "block_picking", "--out", tmp_path / "x", *arguments)
    assert done.returncode == 2
    assert re.search(facts, done.stderr)
    assert done.stderr.count("\n") == 1
    assert not (tmp_path / "x").exists()


def test_a_folder_with_other_data_is_refused(picked, tmp_path):
    before = contents(picked)
    for arguments, facts in (
        (("expert", "--task", "all", "--out", picked), "a dataset; --task all .*folder"),
        (
            ("expert", "--task", "block_picking", "--out", picked),
            r"config\.world\.cameras\.front\.height .*16\b.* 76\b",
        ),
        (
            ("expert", "--task", "block_picking", "--image-size", 16, "--robot", "ur5e_sim", "--out", picked),
            r"config\.world\.robot\.name .*'panda_sim'.*'ur5e_sim'",
        ),
        (("centering", "--out", picked), "task .*'block_picking'.* 'centering'"),
    ):
        done = collect(*arguments)
        assert done.returncode == 1
        assert re.search(facts, done.stderr)
        assert done.stderr.count("\n") == 1
    assert contents(picked) == before
