"""How far a policy's actions are from demonstrations: what a training measures, on any dataset, without a simulator."""

import json
import re
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from svfl_data.datasets.dataset import Dataset
from svfl_data.storage.store import write_episode
from svfl_models import cli
from svfl_models.cloning.config import CloningConfig
from svfl_models.cloning.evaluation.action_errors import action_errors, mean_of
from svfl_models.cloning.train import train_cloning
from svfl_models.training import run_folder
from tests.helpers.demonstrations import demonstration, demonstrations, write
from tests.helpers.own_robot import ACTION, own_dataset, own_episode

pytestmark = pytest.mark.slow

QUIET = Console(quiet=True)
OWN = ["cameras/wrist", "streams/wrench/wrench=8@500", "observations/tcp_velocity"]
FEW = {"preset": "tiny", "image_size": 8, "valid": 1 / 3, "epochs": 1}


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """The dataset, the checkpoint and the outcome of a policy with the paper's inputs."""
    folder, out = demonstrations(tmp_path_factory.mktemp("data") / "picking", 9), tmp_path_factory.mktemp("run")
    result = train_cloning(CloningConfig(str(folder), episodes=6, **FEW), out, QUIET)
    return folder, out / run_folder.CHECKPOINT, result


@pytest.fixture(scope="module")
def own(tmp_path_factory):
    """The same of a policy with inputs and an action of its own."""
    folder, out = own_dataset(tmp_path_factory.mktemp("data") / "mine", 6).path, tmp_path_factory.mktemp("run")
    result = train_cloning(CloningConfig(str(folder), episodes=6, inputs=OWN, **FEW), out, QUIET)
    return folder, out / run_folder.CHECKPOINT, result


def overall(found, name):
    """The mean over all steps."""
    return np.average(found.errors[name], weights=found.steps)


def test_errors_are_those_of_the_trainings_last_validation(trained):
    folder, checkpoint, result = trained
    found = action_errors(checkpoint, folder)
    assert found.held_out
    assert len(found.episodes) == 5  # two held out, and three that the training did not ask for
    validated = [place for place, index in enumerate(found.episodes) if index < 6]
    part = replace(
        found, steps=[found.steps[place] for place in validated],
        errors={name: [values[place] for place in validated] for name, values in found.errors.items()},
    )  # fmt: skip
    for name in ("gripper", "xy_mm", "z_mm", "turn_deg", "error"):
        assert overall(part, name) == pytest.approx(getattr(result, f"valid_{name}"), rel=1e-4)


def test_errors_of_own_actions_are_shares_of_their_ranges(own):
    folder, checkpoint, result = own
    found = action_errors(checkpoint, folder)
    assert len(found.episodes) == 2
    assert overall(found, "error") == pytest.approx(result.valid_error, rel=1e-4)
    assert overall(found, "gripper") == pytest.approx(result.valid_gripper, rel=1e-4)
    components = [overall(found, name) for name in ACTION.components]
    assert np.mean(components) == pytest.approx(result.valid_error, rel=1e-4)


def test_another_dataset_is_used_whole_but_for_failures(trained, tmp_path):
    _, checkpoint, _ = trained
    folder = write(tmp_path / "other", [demonstration(index, success=index != 1) for index in range(4)])
    found = action_errors(checkpoint, folder)
    assert (found.episodes, found.held_out) == ([0, 2, 3], False)
    assert action_errors(checkpoint, folder, episodes=2).episodes == [0, 2]


def test_the_command_writes_numbers_and_a_report_and_needs_no_simulator(trained):
    folder, checkpoint, _ = trained
    code = (
        "import sys\nsys.modules['pybullet'] = sys.modules['gymnasium'] = None\nfrom svfl_models import cli\n"
        f"sys.exit(cli.main(['evaluate', {str(checkpoint)!r}, '--data', {str(folder)!r}]))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert re.search(
        r"5 episodes that it has not learned from .*\(dx, dy\) off [\d.]+ \([\d.]+ to [\d.]+\) mm", done.stdout
    )
    numbers = json.loads((checkpoint.parent / run_folder.ACTION_ERRORS).read_text())
    assert len(numbers["errors"]["xy_mm"]) == len(numbers["episodes"]) == 5
    mean = numbers["means"]["xy_mm"]
    assert mean["mean"] == pytest.approx(np.mean(numbers["errors"]["xy_mm"]))
    assert mean["interval"][0] <= mean["mean"] <= mean["interval"][1]
    page = (checkpoint.parent / run_folder.ACTION_ERRORS_PAGE).read_text()
    assert all(re.search(rf"^\| {index} \| 6 \|", page, re.MULTILINE) for index in numbers["episodes"])
    assert "another task" not in page
    assert "unknown" not in page


def test_a_page_says_what_is_special(trained, tmp_path):
    _, checkpoint, _ = trained
    folder = demonstrations(tmp_path / "pushing", 1, task="block_pushing")
    page = action_errors(checkpoint, folder).page()
    assert "has learned another task, block" in page
    assert "Of one episode the spread between episodes is unknown." in page


def changed(episode, **arrays):
    found = dict(episode.arrays)
    for name, values in arrays.items():
        found |= {path: values for path in found if path.endswith(f"front/{name}")}
    return replace(episode, arrays=found)


def slow(episode):
    found = dict(episode.arrays)
    return replace(episode, arrays=found | {path: 2 * found[path] for path in found if path.endswith("/t_ns")})


def renamed(episode):
    arrays = {path.replace("cameras/front", "cameras/side"): values for path, values in episode.arrays.items()}
    return replace(episode, arrays=arrays)


@pytest.mark.parametrize(
    ("odd", "facts"),
    [
        (renamed, "no camera front; recorded cameras: side"),
        (lambda _: demonstration(0, size=12), "learned from image_side of front 10, the recordings have 12"),
        (lambda one: changed(one, image_axes=np.eye(2)), "learned from image_axes of front"),
        (slow, r"learned from step_ms 50\.0, the recordings have 100\.0"),
    ],
)
def test_recordings_of_other_things_are_one_clear_line(odd, facts, trained, tmp_path, capsys):
    _, checkpoint, _ = trained
    folder = write(tmp_path / "odd", [odd(demonstration(0))])
    assert cli.main(["evaluate", str(checkpoint), "--data", str(folder)]) == 1
    said = capsys.readouterr().err
    assert re.search(facts, said)
    assert said.count("\n") == 1


def wide(episode):
    action = replace(ACTION, bounds=tuple((2 * low, 2 * high) for low, high in ACTION.bounds))
    return replace(episode, declarations=episode.declarations.with_own([action]))


def blind(episode):
    return replace(episode, arrays={path: one for path, one in episode.arrays.items() if "wrist" not in path})


@pytest.mark.parametrize(
    ("odd", "facts"),
    [(wide, "learned from low of actions/action"), (blind, "no camera 'wrist'")],
)
def test_recordings_of_other_inputs_or_actions_are_one_clear_line(odd, facts, own, tmp_path, capsys):
    _, checkpoint, _ = own
    dataset = Dataset.create_or_resume(tmp_path / "odd", "wiping", 0, {})
    write_episode(odd(own_episode(0)), dataset.episode_path(0))
    assert cli.main(["evaluate", str(checkpoint), "--data", str(dataset.path)]) in (1, 2)
    said = capsys.readouterr().err
    assert re.search(facts, said)
    assert said.count("\n") == 1


def test_nothing_to_compare_with_is_one_clear_line(trained, tmp_path, capsys):
    _, checkpoint, _ = trained
    folder = demonstrations(tmp_path / "failed", 2, success=False)
    assert cli.main(["evaluate", str(checkpoint), "--data", str(folder)]) == 1
    assert "no successful episodes" in capsys.readouterr().err


@pytest.mark.parametrize("option", [("--seed", "1"), ("--robot", "ur5e_sim"), ("--env", "a"), ("--workers", "2")])
def test_options_of_a_simulation_are_refused_beside_a_dataset(option, trained, capsys):
    folder, checkpoint, _ = trained
    assert cli.main(["evaluate", str(checkpoint), "--data", str(folder), *option]) == 2
    assert f"{option[0]} is for running a policy" in capsys.readouterr().err


def test_intervals_have_episodes_as_their_unit():
    """Student's t: 2 +- 4.303 / sqrt(3) for 1, 2, 3; and no error is below zero."""
    found = mean_of([1.0, 2.0, 3.0])
    assert found.mean == 2
    assert found.interval == pytest.approx((0, 2 + 4.3027 / np.sqrt(3)), abs=1e-4)
    assert mean_of([5.0]).interval is None
