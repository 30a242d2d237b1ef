"""How often a policy succeeds is counted right, in an environment that is declared here."""

import json
import os
import re
import shutil
import signal

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces
from PIL import Image
from rich.console import Console

import collectors.environment  # noqa: F401 - declares the environments
from collectors.tasks import TASKS
from svfl_data.errors import TrainingError
from svfl_models import cli
from svfl_models.cloning import evaluate as module
from svfl_models.cloning import rollout, train
from svfl_models.cloning.config import CloningConfig
from svfl_models.cloning.deployment_spec import DeploymentSpec
from svfl_models.cloning.evaluate import Evaluation, environment_of, evaluate
from svfl_models.training import run_folder
from tests.helpers.builders import IMAGE_AXES
from tests.helpers.demonstrations import demonstrations
from tests.helpers.tracker_files import tensorboard_numbers

pytestmark = pytest.mark.slow

QUIET = Console(quiet=True)
HERE = "tests.svfl_models.cloning.test_evaluate"


class Countdown(gymnasium.Env):
    """Succeeds after as many steps as the number of the episode says, if it is even; else ends at five."""

    metadata = {"render_modes": ["rgb_array"]}  # noqa: RUF012 - as gymnasium wants it
    observation_space = spaces.Dict({"image": spaces.Box(0, 2, (4, 10, 10), np.float32)})
    action_space = spaces.Box(-1, 1, (5,), np.float32)

    def __init__(self, axes=IMAGE_AXES, camera=None, render_mode=None):
        self.image_axes, self.seen, self.render_mode = axes, [], render_mode

    def reset(self, *, seed=None, options=None):
        self.drawn, self.step_number = options["scene"], 0
        self.seen.append(self.drawn)
        return self._see(), {"success": False}

    def step(self, action):
        assert action.shape == (5,)
        assert action.dtype == np.float32
        assert action[0] in (0, 1)
        self.step_number += 1
        index = self.drawn[1]
        success = index % 2 == 0 and self.step_number > index
        return self._see(), float(success), success, self.step_number == 5 and not success, {"success": success}

    def render(self):
        return None if self.render_mode is None else np.full((10, 10, 3), 20 * self.step_number, np.uint8)

    def _see(self):
        zeros = {"image": (4, 10, 10), "wrench": (64, 6), "proprio": (5,)}
        return {name: np.zeros(shape, np.float32) for name, shape in zeros.items()}


class Blind(Countdown):
    """Has no images."""

    def render(self):
        return None


class Deadly(Countdown):
    """Kills its process at the first step."""

    def step(self, action):
        os.kill(os.getpid(), signal.SIGKILL)


if "test/Countdown-v0" not in gymnasium.registry:  # this module is imported once more, by its own name
    gymnasium.register("test/Countdown-v0", f"{HERE}:Countdown")
    gymnasium.register("test/Blind-v0", f"{HERE}:Blind")
    gymnasium.register("test/Deadly-v0", f"{HERE}:Deadly")
    gymnasium.register("test/Turned-v0", f"{HERE}:Countdown", kwargs={"axes": np.eye(2)})
COUNTDOWN = f"{HERE}:test/Countdown-v0"


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory):
    folder = demonstrations(tmp_path_factory.mktemp("data") / "picking")
    config = CloningConfig(str(folder), 6, "p", preset="tiny", image_size=8, valid=1 / 3, epochs=1)
    out = tmp_path_factory.mktemp("run")
    train.train_cloning(config, out, QUIET)
    return out / run_folder.CHECKPOINT


@pytest.fixture
def countdown(monkeypatch):
    monkeypatch.setattr(module, "environment_of", lambda task: COUNTDOWN)


@pytest.mark.parametrize("workers", [1, 2])
def test_successes_and_steps_are_counted(workers, checkpoint, countdown):
    found = evaluate(checkpoint, 6, seed=3, workers=workers, console=QUIET)
    assert found.success == [True, False, True, False, True, False]
    assert found.steps == [1, 5, 3, 5, 5, 5]
    assert (found.rate, found.median_steps) == (0.5, 3)


def test_scenes_are_those_of_no_demonstration(checkpoint):
    trial = module.Trial(checkpoint, COUNTDOWN, seed=3)
    for index in range(4):
        trial(index)
    assert trial.environment.unwrapped.seen == [(3, index) for index in range(4)]


@pytest.mark.parametrize(
    ("successes", "trials", "low", "high"), [(0, 10, 0.0, 0.2775), (8, 10, 0.4902, 0.9433), (10, 10, 0.7225, 1.0)]
)
def test_the_interval_is_wilsons(successes, trials, low, high):
    """R. G. Newcombe, Statistics in Medicine 17, 1998: the score interval without continuity correction."""
    found = Evaluation("x", "y", 0, [index < successes for index in range(trials)], [1] * trials)
    np.testing.assert_allclose(found.interval, (low, high), atol=1e-4)


def test_the_command_writes_and_prints(checkpoint, countdown, capsys):
    assert cli.main(["evaluate", str(checkpoint), "--episodes", "4"]) == 0
    assert (
        "2 of 4 episodes succeeded, 50.0% (95 % interval 15.0% to 85.0%), 2 steps (median)" in capsys.readouterr().out
    )
    found = json.loads((checkpoint.parent / "evaluation.json").read_text())
    assert found["success"] == [True, False, True, False]
    assert (found["environment"], found["seed"], found["rate"]) == (COUNTDOWN, 0, 0.5)


def test_a_film_shows_every_step(checkpoint, monkeypatch, tmp_path):
    monkeypatch.setattr(rollout, "environment_of", lambda task: COUNTDOWN)
    file = rollout.film(checkpoint, tmp_path / "film.gif", seed=3, index=2)
    film = Image.open(file)
    assert film.size == (220, 220)
    shown = []
    for number in range(film.n_frames):
        film.seek(number)
        shown.append(np.asarray(film.convert("RGB"))[0, 0, 0])
    assert shown == [0, 20, 40, 60]  # the start, and three steps until it succeeds
    monkeypatch.setattr(rollout, "environment_of", lambda task: f"{HERE}:test/Blind-v0")
    with pytest.raises(TrainingError, match="cannot be filmed"):
        rollout.film(checkpoint, tmp_path / "film.gif")


def test_an_evaluation_is_logged_where_the_training_was(checkpoint, countdown, monkeypatch, tmp_path):
    pytest.importorskip("tensorboard")
    monkeypatch.setattr(rollout, "environment_of", lambda task: COUNTDOWN)
    out = tmp_path / "run"
    shutil.copytree(checkpoint.parent, out)
    found = evaluate(out / run_folder.CHECKPOINT, 4, console=QUIET)
    rollout.log_evaluation(found, ["tensorboard"])
    numbers, pictures = tensorboard_numbers(out)
    assert numbers["success_rate"] == [(1, 0.5)]  # after the only step of the training
    assert pictures["rollout"] == [(out / run_folder.ROLLOUT).read_bytes()]


def test_other_environments_are_one_clear_line(checkpoint):
    with pytest.raises(TrainingError, match="test/Nothing-v0"):
        module.Trial(checkpoint, "test/Nothing-v0", 0)
    seen = DeploymentSpec("picking", "front", IMAGE_AXES.tolist(), image_side=10)
    learned, given = (re.escape(str(axes.tolist())) for axes in (IMAGE_AXES, np.eye(2)))
    with pytest.raises(TrainingError, match=f"camera front .*{learned}.* {given}"):
        module._expect_same(gymnasium.make("test/Turned-v0"), seen, "policy")


def test_a_worker_that_dies_is_one_clear_line(checkpoint, monkeypatch):
    monkeypatch.setattr(module, "environment_of", lambda task: f"{HERE}:test/Deadly-v0")
    with pytest.raises(TrainingError, match="died"):
        evaluate(checkpoint, 4, workers=2, console=QUIET)


def test_a_file_that_is_no_policy(tmp_path, capsys):
    assert cli.main(["evaluate", str(tmp_path / "nothing.ckpt")]) == 1
    assert str(tmp_path / "nothing.ckpt") in capsys.readouterr().err


def test_every_task_has_its_id():
    assert environment_of("block_corner_pulling") == "collectors.environment:svfl/block_corner_pulling-v0"
    for task in TASKS:
        assert gymnasium.spec(environment_of(task).partition(":")[2]).kwargs == {"task": task}
