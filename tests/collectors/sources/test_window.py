"""A policy that learned from another number of wrench readings acts, and is evaluated, on just these."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from collectors.environment import Environment
from collectors.sources import policy as collecting
from collectors.sources.expert import ExpertCollector
from collectors.sources.policy import PolicyCollector
from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import TrainingError, UsageError
from svfl_data.sampling.cut import cut_steps
from svfl_data.schema.input_spec import WRENCH, paper_inputs
from svfl_data.storage.store import write_episode
from svfl_models import cli
from svfl_models.cloning import acting, train
from svfl_models.cloning.checkpoint import load_policy
from svfl_models.cloning.config import CloningConfig
from svfl_models.cloning.evaluate import evaluate
from svfl_models.cloning.evaluation import other_environments
from svfl_models.cloning.evaluation.action_errors import action_errors
from svfl_models.deployment import policy_predictions, predictions
from svfl_models.networks.action_space import PLANAR
from svfl_models.programs import exported_policy
from svfl_models.training import run_folder

pytestmark = pytest.mark.slow

QUIET = Console(quiet=True)
SCALE = np.array(PLANAR.scale)
WINDOWS = (24, 96)


@pytest.fixture(scope="module")
def config(tmp_path_factory):
    folder = tmp_path_factory.mktemp("data") / "block_picking"
    expert = ExpertCollector(0, "block_picking")
    dataset = Dataset.create_or_resume(folder, "block_picking", 0, expert.config())
    for index in range(3):
        write_episode(expert(index), dataset.episode_path(index))
    expert.opened.close()
    return CloningConfig(str(folder), 3, "fp", seed=2, preset="tiny", valid=1 / 3, epochs=2)


@pytest.fixture(scope="module", params=WINDOWS)
def trained(request, config, tmp_path_factory):
    """The window, the result and the checkpoint of a training."""
    out = tmp_path_factory.mktemp("run")
    result = train.train_cloning(replace(config, window=request.param), out, QUIET)
    return request.param, result, out / run_folder.CHECKPOINT


def test_it_acts_on_the_last_readings_of_its_window(trained, monkeypatch):
    """While it is recorded, as an exported file, in the environment and in the viewer."""
    window, _, checkpoint = trained
    monkeypatch.setattr(collecting, "loader", lambda path: acting.load)
    collector = PolicyCollector(5, "block_picking", checkpoint)
    episode = collector(1)
    collector.opened.close()
    file = checkpoint.with_name("policy.pt2")
    assert cli.main(["export", str(checkpoint), "--out", str(file)]) == 0
    policy = exported_policy.load(file)
    assert policy.window == window
    seen = cut_steps(episode, paper_inputs(window=window), range(len(episode)))
    assert seen[WRENCH].shape[1] == window
    for step in range(len(episode)):
        said = policy.act({path: values[step : step + 1] for path, values in seen.items()}, "")
        np.testing.assert_allclose(episode.action[step] / SCALE, said / SCALE, atol=1e-4)
    thought = predictions.load(checkpoint)(episode)
    np.testing.assert_allclose(thought.actions[:-1] / SCALE, episode.action / SCALE, atol=1e-4)
    exported = policy_predictions.of_program(policy, "policy")(episode)
    np.testing.assert_allclose(exported.actions / SCALE, thought.actions / SCALE, atol=1e-4)
    found = evaluate(checkpoint, 2, seed=5, console=QUIET)
    assert (found.success[1], found.steps[1]) == (episode.meta.success, len(episode))


def test_its_errors_are_those_of_its_training(trained, config):
    _, result, checkpoint = trained
    found = action_errors(checkpoint, config.data)
    assert np.average(found.errors["xy_mm"], weights=found.steps) == pytest.approx(result.valid_xy_mm, rel=1e-4)


def test_it_says_so(trained, capsys):
    window, _, checkpoint = trained
    assert cli.main(["info", str(checkpoint), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["inputs"]["wrench"] == f"{window} readings"
    module = load_policy(checkpoint)
    given = rf"wrench of shape \({window}, 6\), the environment gives \(64, 6\)"
    with Environment("block_picking") as usual, pytest.raises(TrainingError, match=given):
        other_environments.expect_inputs(usual, module, "policy")
    with Environment("block_picking", window=window) as fitting:
        other_environments.expect_inputs(fitting, module, "policy")
        assert fitting.reset(seed=0)[0]["wrench"].shape == (window, 6)


def test_other_inputs_have_windows_of_their_own(config, tmp_path, capsys):
    inputs = ["streams/wrench/wrench=32@500", "observations/proprio"]
    with pytest.raises(UsageError, match=r"--window 32 and --inputs .*wrench=32@500"):
        replace(config, inputs=inputs, window=32)
    assert replace(config, inputs=inputs).window == 64  # as in the run.yaml of such a run
    words = ["bc", "--data", config.data, "--window", "32", "--inputs", *inputs, "--out", str(tmp_path / "run")]
    assert cli.main(words) == 2
    error = capsys.readouterr().err
    assert re.search("--window 32 and --inputs contradict each other", error)
    assert error.count("\n") == 1
    assert not (tmp_path / "run").exists()
