"""How often a policy succeeds is counted right, in an environment that is declared here."""

import json
import os
import re
import shutil
import signal
from dataclasses import asdict

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
from svfl_models.cloning import train
from svfl_models.cloning.config import CloningConfig
from svfl_models.cloning.deployment_spec import DeploymentSpec
from svfl_models.cloning.evaluate import Evaluation, environment_of, evaluate
from svfl_models.cloning.evaluation import rollout
from svfl_models.training import run_folder
from svfl_models.training.provenance.session import file
from tests.helpers.builders import IMAGE_AXES
from tests.helpers.command_page import json_keys
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


class Elsewhere(gymnasium.Env):
    """Of another package: its scenes come from seeds, and it takes no options and gives numbers of its own kind."""

    observation_space = spaces.Dict({"proprio": spaces.Box(-1, 1, (5,), np.float64)})
    action_space = spaces.Box(-1, 1, (5,), np.float32)

    def __init__(self, tells=True, limit=4, length=2):
        self.tells, self.limit, self.length, self.seeds = tells, limit, length, []

    def reset(self, *, seed=None, options=None):
        assert options is None
        super().reset(seed=seed)
        self.seeds.append(seed)
        self.good, self.step_number = bool(self.np_random.integers(2)), 0
        return self.observation_space.sample(), {}

    def step(self, action):
        self.step_number += 1
        done = self.step_number == self.length
        info = {"success": done and self.good} if self.tells else {}
        return self.observation_space.sample(), 0.0, done, self.step_number == self.limit, info


class Unnamed(Elsewhere):
    """Its observation is no dictionary."""

    observation_space = spaces.Box(-1, 1, (5,), np.float32)


class Blind(Elsewhere):
    """It has other inputs."""

    observation_space = spaces.Dict({"joints": spaces.Box(-1, 1, (7,), np.float32)})


class Jointed(Elsewhere):
    """It takes other actions."""

    action_space = spaces.Box(-1, 1, (7,), np.float32)


class Unseen(Countdown):
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
    gymnasium.register("test/Elsewhere-v0", f"{HERE}:Elsewhere")
    gymnasium.register("test/Silent-v0", f"{HERE}:Elsewhere", kwargs={"tells": False})
    gymnasium.register("test/Late-v0", f"{HERE}:Elsewhere", kwargs={"tells": False, "length": 9})
    gymnasium.register("test/Endless-v0", f"{HERE}:Elsewhere", kwargs={"limit": None, "length": None})
    gymnasium.register("test/Unnamed-v0", f"{HERE}:Unnamed")
    gymnasium.register("test/Unseen-v0", f"{HERE}:Unseen")
    gymnasium.register("test/Jointed-v0", f"{HERE}:Jointed")
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
    assert found["provenance"]["data"]["checkpoint"] == asdict(file(checkpoint))
    assert found["provenance"]["seeds"] == [0]
    assert cli.main(["info", str(checkpoint)]) == 0
    assert re.search(r"results, evaluation.json\n(    .*\n)*    rate +0\.5\n", capsys.readouterr().out)
    assert cli.main(["evaluate", str(checkpoint), "--episodes", "4", "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert {name: value for name, value in printed.items() if name != "provenance"} == {
        name: value for name, value in found.items() if name != "provenance"
    }
    assert found.keys() == json_keys("svfl-train evaluate")


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
    monkeypatch.setattr(rollout, "environment_of", lambda task: f"{HERE}:test/Unseen-v0")
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


def test_an_environment_of_another_wrench_rate_is_one_clear_line():
    env = gymnasium.make("test/Countdown-v0")
    env.unwrapped.wrench_hz = 500.0
    for learned_hz in (0.0, 260.0, 500.0, 990.0):
        module._expect_same(env, DeploymentSpec("picking", wrench_hz=learned_hz), "policy")
    with pytest.raises(TrainingError, match=r"policy: learned from wrench readings at 100 Hz, .* come at 500 Hz"):
        module._expect_same(env, DeploymentSpec("picking", wrench_hz=100.0), "policy")


def test_a_worker_that_dies_is_one_clear_line(checkpoint, monkeypatch):
    monkeypatch.setattr(module, "environment_of", lambda task: f"{HERE}:test/Deadly-v0")
    with pytest.raises(TrainingError, match="died"):
        evaluate(checkpoint, 4, workers=2, console=QUIET)


@pytest.mark.parametrize("workers", [1, 2])
def test_a_policy_acts_in_an_environment_of_another_package(workers, checkpoint):
    """Its successes are those that it tells, its scenes are the same every time."""
    name = f"{HERE}:test/Elsewhere-v0"
    found = evaluate(checkpoint, 12, seed=3, workers=workers, console=QUIET, environment=name)
    assert found.environment == name
    assert 0 < sum(found.success) < 12
    assert found.steps == [2] * 12
    again = evaluate(checkpoint, 12, seed=3, console=QUIET, environment=name)
    assert (again.success, again.steps) == (found.success, found.steps)
    assert evaluate(checkpoint, 12, seed=4, console=QUIET, environment=name).success != found.success


@pytest.mark.parametrize(("name", "success"), [("Silent", [True] * 2), ("Late", [False] * 2), ("Endless", [False] * 2)])
def test_without_a_told_success_an_episode_succeeds_by_terminating(name, success, checkpoint, monkeypatch):
    monkeypatch.setattr(module, "LONGEST", 30)
    found = evaluate(checkpoint, 2, console=QUIET, environment=f"{HERE}:test/{name}-v0")
    assert found.success == success
    assert name != "Endless" or found.steps == [30] * 2


@pytest.mark.parametrize(
    ("name", "facts"),
    [
        ("Unnamed", "takes inputs by name.* no dictionary"),
        ("Blind", "takes proprio, .* has joints"),
        ("Jointed", r"gives 5 numbers, .*\(7,\)"),
        ("Nowhere", r"cannot be evaluated in .*test/Nowhere-v0"),
        ("no_such_package:test/Countdown-v0", "cannot be evaluated in no_such_package:.*no_such_package"),
    ],
)
def test_environments_that_do_not_fit_are_one_clear_line(name, facts, checkpoint, capsys):
    environment = name if ":" in name else f"{HERE}:test/{name}-v0"
    assert cli.main(["evaluate", str(checkpoint), "--env", environment]) == 1
    said = capsys.readouterr().err
    assert re.search(facts, said)
    assert said.count("\n") == 1


def test_the_robot_of_another_environment_is_its_own(checkpoint, capsys):
    words = ["evaluate", str(checkpoint), "--env", f"{HERE}:test/Elsewhere-v0", "--robot", "ur5e_sim"]
    assert cli.main(words) == 2
    assert "has its own robot" in capsys.readouterr().err


def test_a_file_that_is_no_policy(tmp_path, capsys):
    assert cli.main(["evaluate", str(tmp_path / "nothing.ckpt")]) == 1
    assert str(tmp_path / "nothing.ckpt") in capsys.readouterr().err


def test_every_task_has_its_id():
    assert environment_of("block_corner_pulling") == "collectors.environment:svfl/block_corner_pulling-v0"
    for task in TASKS:
        assert gymnasium.spec(environment_of(task).partition(":")[2]).kwargs == {"task": task}
