"""A policy with inputs of the user's own acts in simulation: learned, exported, evaluated and recorded alike."""

import json
from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from rich.console import Console

from collectors.environment import Environment
from collectors.simulation.camera import cameras_named
from collectors.simulation.config import WorldConfig
from collectors.sources import policy as collecting
from collectors.sources.expert import ExpertCollector
from collectors.sources.policy import PolicyCollector
from collectors.tasks.task import attempt_seed
from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import FieldError, FormatError, TrainingError, UsageError
from svfl_data.sampling.cut import cut_steps
from svfl_data.sampling.samples import Samples
from svfl_data.schema.input_spec import InputSpec, Window
from svfl_data.storage.store import write_episode
from svfl_models import cli
from svfl_models.cloning import acting
from svfl_models.cloning.config import CloningConfig
from svfl_models.cloning.evaluate import evaluate
from svfl_models.cloning.train import train_cloning
from svfl_models.networks.action_space import PLANAR
from svfl_models.programs import own_policy, policy_file
from svfl_models.training import run_folder
from tests.helpers.own_robot import moving_episode, own_dataset

pytestmark = pytest.mark.slow

QUIET = Console(quiet=True)
WORDS = [
    "cameras/front", "cameras/wrist", "streams/wrench/wrench=80@500", "streams/tcp/pose=2@20:invariant",
    "observations/proprio",
]  # fmt: skip
"""The wrench window is longer than that of an observation, and the poses are of two observations."""
SPEC = InputSpec(
    ("front", "wrist"), 1, {"streams/wrench/wrench": Window(80, 500.0), "streams/tcp/pose": Window(2, 20.0)},
    ("observations/proprio",),
)  # fmt: skip
WORLD = WorldConfig(cameras=cameras_named(["front", "wrist"]))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("data") / "block_picking"
    expert = ExpertCollector(0, "block_picking", world=WORLD)
    dataset = Dataset.create_or_resume(folder, "block_picking", 0, expert.config())
    for index in range(3):
        write_episode(expert(index), dataset.episode_path(index))
    expert.opened.close()
    return folder


@pytest.fixture(scope="module")
def checkpoint(folder, tmp_path_factory):
    """A few epochs of two demonstrations, seen in few pixels."""
    config = CloningConfig(str(folder), 3, seed=2, preset="tiny", image_size=16, valid=1 / 3, epochs=3, inputs=WORDS)
    out = tmp_path_factory.mktemp("run")
    train_cloning(config, out, QUIET)
    return out / run_folder.CHECKPOINT


@pytest.fixture(scope="module")
def file(checkpoint):
    """The same policy, exported."""
    found = checkpoint.with_name("policy.pt2")
    assert cli.main(["export", str(checkpoint), "--out", str(found)]) == 0
    return found


@pytest.fixture
def loaders(monkeypatch):
    """The loaders of this source tree, whether or not it is the one that is installed."""
    load = {".ckpt": acting.load, ".pt2": policy_file.load}
    monkeypatch.setattr(collecting, "loader", lambda path: load[path.suffix])


def record(path, index, world=WORLD):
    collector = PolicyCollector(5, "block_picking", path, world)
    try:
        return collector(index)
    finally:
        collector.opened.close()


def test_recording_and_evaluating_are_one(checkpoint, file, loaders):
    one, other = (record(path, 1) for path in (checkpoint, file))
    assert np.ptp(one.action[:, 1:], axis=0).min() > 0
    np.testing.assert_allclose(one.action / PLANAR.scale, other.action / PLANAR.scale, atol=1e-4)
    found = evaluate(checkpoint, 2, seed=5, console=QUIET)
    assert (found.success[1], found.steps[1]) == (one.meta.success, len(one))


def test_the_recorded_actions_are_those_of_the_recorded_observations(checkpoint, file, loaders):
    """What is seen while acting is what training sees of the episode, in every step."""
    collector = PolicyCollector(5, "block_picking", checkpoint, WORLD)
    policy = own_policy.load(file)
    for index in (2, 0):  # one collector: the second episode does not see the first
        episode = collector(index)
        seen = cut_steps(episode, SPEC, range(len(episode)))
        for step in range(len(episode)):
            said = policy({path: values[step] for path, values in seen.items()})
            np.testing.assert_allclose(episode.action[step] / PLANAR.scale, said / PLANAR.scale, atol=1e-4)
    collector.opened.close()


def test_the_environment_gives_what_samples_give(folder):
    samples = Samples(Dataset.open(folder), [1], cameras=SPEC.cameras, windows=SPEC.windows, vectors=SPEC.vectors)
    recorded = Dataset.open(folder).read(1)
    env = Environment("block_picking", inputs=SPEC)
    seen, _ = env.reset(options={"seed_sequence": attempt_seed(0, 1, recorded.meta.config["attempt"])})
    for step in range(4):
        sample = samples[step]
        assert set(seen) == {key for key in sample if key in env.observation_space.spaces}
        assert env.observation_space.contains(seen)
        for path, values in seen.items():
            np.testing.assert_allclose(values, sample[path], atol=1e-6, err_msg=f"{step} {path}")
        seen, *_ = env.step(recorded.action[step])
    env.close()


def test_it_is_an_environment_as_gymnasium_wants_it():
    env = gymnasium.make("collectors.environment:svfl/block_picking-v0", inputs=SPEC, disable_env_checker=True)
    check_env(env.unwrapped, skip_render_check=True)
    env.close()


@pytest.mark.parametrize(
    ("inputs", "error", "facts"),
    [
        (InputSpec(cameras=("back",)), UsageError, r"no camera 'back'.*front, top"),
        (InputSpec(vectors=("observations/velocity",)), FieldError, r"no observations/velocity; it has .*proprio"),
        (InputSpec(windows={"streams/tactile/pressure": Window(3)}), FieldError, "no streams/tactile/t_ns"),
    ],
)
def test_what_the_simulation_does_not_give_is_one_line(inputs, error, facts):
    with pytest.raises(error, match=facts) as caught:
        Environment("block_picking", inputs=inputs)
    assert "\n" not in str(caught.value)


def test_a_robot_without_the_camera_is_one_line(checkpoint, loaders):
    with pytest.raises(FieldError, match=r"no cameras/wrist/t_ns; it has .*cameras/front/color"):
        record(checkpoint, 0, WorldConfig())


def test_the_robot_of_the_demonstrations_acts_unless_another_is_named(checkpoint, tmp_path, capsys):
    out = tmp_path / "evaluation.json"
    words = ["evaluate", str(checkpoint), "--episodes", "1", "--out", str(out)]
    assert cli.main([*words, "--robot", "ur5e_sim"]) == 0
    assert len(json.loads(out.read_text())["success"]) == 1
    assert cli.main([*words, "--robot", "nobody"]) == 1
    assert "no robot 'nobody'; possible are panda_sim, ur5e_sim" in capsys.readouterr().err


def test_each_file_is_opened_by_its_own_mark(checkpoint, file, tmp_path):
    assert isinstance(policy_file.load(file), policy_file.RobotPolicy)
    assert isinstance(acting.load(checkpoint), policy_file.RobotPolicy)
    with pytest.raises(FormatError, match="no such file"):
        policy_file.load(tmp_path / "none.pt2")


def test_an_action_that_the_environment_does_not_take_is_one_line(tmp_path):
    dataset = own_dataset(tmp_path / "mine", 0)
    for index in range(4):
        episode = moving_episode(index)
        meta = replace(episode.meta, task="block_picking", robot="")
        write_episode(replace(episode, meta=meta), dataset.episode_path(index))
    config = CloningConfig(
        str(dataset.path), 4, preset="tiny", image_size=8, valid=0.25, epochs=1, inputs=["streams/wrench/wrench=8@500"]
    )
    train_cloning(config, tmp_path / "run", QUIET)
    with pytest.raises(TrainingError, match=r"gives 7 numbers \(dx, dy, dz, rx, ry, rz, opening\).*\(5,\)"):
        evaluate(tmp_path / "run" / run_folder.CHECKPOINT, 1, console=QUIET)
