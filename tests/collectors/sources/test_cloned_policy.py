"""From demonstrations to a policy that collectors run: learned, exported, tried, recorded, always the same policy."""

import json
import os
import tomllib
from importlib import import_module
from pathlib import Path

import gymnasium
import numpy as np
import pytest
import torch
from rich.console import Console

from collectors.simulation.config import WorldConfig
from collectors.sources import policy as collecting
from collectors.sources.expert import ExpertCollector
from collectors.sources.policy import PolicyCollector
from collectors.tasks import TASKS
from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import FormatError, TrainingError, UsageError
from svfl_data.schema.robot import Frame, Observation
from svfl_data.storage.store import write_episode
from svfl_models import cli
from svfl_models.cloning import acting, train
from svfl_models.cloning.checkpoint import load_policy
from svfl_models.cloning.config import CloningConfig
from svfl_models.cloning.evaluate import environment_of, evaluate
from svfl_models.configuration.resolving import build
from svfl_models.deployment import predictions
from svfl_models.experiments import cloning_table
from svfl_models.networks.action_space import PLANAR
from svfl_models.programs import exported_policy
from svfl_models.symmetry.layers import SymmetricConv
from svfl_models.training import run_folder
from tests.helpers import added_robot
from tests.helpers.synthetic import centering_samples
from tests.helpers.trained import untrained, write

pytestmark = pytest.mark.slow

QUIET = Console(quiet=True)
ROOT = Path(__file__).parents[3]

SCALE = np.array(PLANAR.scale)


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory):
    """A few epochs of two demonstrations, seen in few pixels."""
    folder = tmp_path_factory.mktemp("data") / "block_picking"
    expert = ExpertCollector(0, "block_picking")
    dataset = Dataset.create_or_resume(folder, "block_picking", 0, expert.config())
    for index in range(3):
        write_episode(expert(index), dataset.episode_path(index))
    expert.opened.close()
    config = CloningConfig(str(folder), 3, seed=2, image_size=16, valid=1 / 3, epochs=4)
    out = tmp_path_factory.mktemp("run")
    train.train_cloning(config, out, QUIET)
    return out / "checkpoint.ckpt"


@pytest.fixture(scope="module")
def file(checkpoint):
    """The same policy, exported."""
    found = checkpoint.with_name("policy.pt2")
    assert cli.main(["export", str(checkpoint), "--out", str(found)]) == 0
    return found


def test_three_ways_to_act_are_one(checkpoint, file, monkeypatch):
    """Recording the checkpoint, recording the exported file, and trying it in the environment."""
    load = {".ckpt": acting.load, ".pt2": exported_policy.load}
    monkeypatch.setattr(collecting, "loader", lambda path: load[path.suffix])
    recorded = []
    for path in (checkpoint, file):
        collector = PolicyCollector(5, "block_picking", path)
        recorded.append(collector(1))
        collector.opened.close()
    one, other = recorded
    assert np.ptp(one.action[:, 1:], axis=0).min() > 0
    np.testing.assert_allclose(one.action / SCALE, other.action / SCALE, atol=1e-4)
    found = evaluate(checkpoint, 2, seed=5, console=QUIET)
    assert (found.success[1], found.steps[1]) == (one.meta.success, len(one))


def test_a_policy_is_evaluated_on_a_robot_that_another_package_adds(checkpoint, tmp_path, monkeypatch):
    """Also in worker processes, which look its name up for themselves."""
    robot = added_robot.install(tmp_path, monkeypatch)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")]))
    found = evaluate(checkpoint, 2, seed=5, console=QUIET, robot=robot)
    assert len(found.steps) == 2
    assert evaluate(checkpoint, 2, seed=5, workers=2, console=QUIET, robot=robot).steps == found.steps


def test_a_policy_is_evaluated_in_another_task_of_this_package(checkpoint):
    found = evaluate(checkpoint, 1, console=QUIET, environment="svfl/block_pushing-v0")
    assert (found.environment, found.success) == (environment_of("block_pushing"), [False])


def test_what_the_viewer_says_that_it_would_do_is_what_it_did(checkpoint):
    collector = PolicyCollector(5, "block_picking", checkpoint)
    episode = collector(2)
    collector.opened.close()
    prediction = predictions.load(checkpoint)(episode)
    np.testing.assert_allclose(prediction.actions[:-1] / SCALE, episode.action / SCALE, atol=1e-4)


def test_a_loaded_policy_says_what_its_network_says(checkpoint, file):
    """In base axes, from what a collector sees; the network is the one with symmetric layers."""
    module = load_policy(checkpoint)
    network = acting.ActingPolicy(module.policy, module.deployment, module.view).eval()
    assert any(isinstance(part, SymmetricConv) for part in network.modules())
    for policy in (acting.load(checkpoint), exported_policy.load(file)):
        for observation, action in seen_and_said(network):
            np.testing.assert_allclose(policy(observation) / SCALE, action / SCALE, atol=1e-5)


def seen_and_said(network):
    """Random observations of collectors, and the actions that a network gives for them."""
    rng, times = np.random.default_rng(0), {"streams/wrench/t_ns": np.arange(-63, 1) * 2_000_000}
    for _ in range(4):
        frame = Frame(
            rng.integers(0, 256, (76, 76, 3), dtype=np.uint8), rng.integers(5000, 9000, (76, 76)).astype(np.uint16)
        )
        wrench, proprio = rng.normal(0, 3, (64, 6)).astype(np.float32), rng.normal(0.3, 0.2, 5).astype(np.float32)
        image = np.concatenate([frame.color.transpose(2, 0, 1) / np.float32(255), frame.depth[None] * np.float32(1e-4)])
        inputs = (torch.from_numpy(part[None].astype(np.float32)) for part in (image, wrench, proprio))
        with torch.no_grad():
            yield (
                Observation(0, {"front": frame}, wrench, proprio, np.zeros(9, np.float32), values=times),
                network(*inputs)[0].numpy(),
            )


def test_another_kind_of_file_is_refused(tmp_path):
    centering = write(untrained(centering_samples(8, seed=0), encoder="f")[0], tmp_path / "centering.ckpt")
    with pytest.raises(FormatError, match=r"svfl-centering.* svfl-policy"):
        acting.load(centering)


def test_a_policy_becomes_no_onnx(checkpoint, capsys):
    with pytest.raises(UsageError, match=r"\.onnx.* \.pt2"):
        acting.export(load_policy(checkpoint), checkpoint.with_name("policy.onnx"))
    assert cli.main(["export", str(checkpoint), "--out", "nowhere/policy.pt2"]) == 1
    assert "nowhere/policy.pt2: " in capsys.readouterr().err


def test_collectors_find_the_loader():
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["entry-points"]["svfl.policies"]
    module, _, name = declared["ckpt"].partition(":")
    assert getattr(import_module(module), name) is acting.load


def test_the_ids_of_the_tasks_are_gymnasiums():
    for name in TASKS:
        module, _, id_ = environment_of(name).partition(":")
        import_module(module)
        assert gymnasium.spec(id_).kwargs == {"task": name}


def test_images_of_another_size_are_one_clear_line(checkpoint, monkeypatch):
    monkeypatch.setattr(collecting, "loader", lambda path: acting.load)
    camera = next(iter(WorldConfig().cameras.values()))
    small = WorldConfig(cameras={"front": type(camera)(height=24, width=24)})
    collector = PolicyCollector(0, "block_picking", checkpoint, small)
    with pytest.raises(TrainingError, match=r"76 x 76 px.* 24 x 24"):
        collector(0)
    collector.opened.close()


def test_an_evaluation_is_written_beside_the_checkpoint(checkpoint, capsys):
    assert cli.main(["evaluate", str(checkpoint), "--episodes", "1"]) == 0
    assert json.loads(checkpoint.with_name("evaluation.json").read_text())["steps"]
    assert "of 1 episodes succeeded" in capsys.readouterr().out


def test_a_table_tries_what_is_trained(checkpoint):
    config = build(CloningConfig, run_folder.read_config(checkpoint.parent))
    run, before = cloning_table.Run(config, checkpoint.parent, test_episodes=2), checkpoint.read_bytes()
    assert run.words() is None
    run()
    assert run.words().endswith(" of 2")
    assert len(run.outcome()["success"]) == 2
    assert checkpoint.read_bytes() == before
