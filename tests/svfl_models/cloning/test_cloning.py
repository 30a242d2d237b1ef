"""Behaviour cloning: its losses, its training, what it leaves, and that an interruption leaves no trace."""

import csv
import json
import math
import re
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
import torch
from matplotlib import pyplot as plt
from rich.console import Console

from svfl_data.errors import FormatError, TrainingError
from svfl_models import cli
from svfl_models.cloning import report, train
from svfl_models.cloning.checkpoint import load_policy
from svfl_models.cloning.config import LOSSES, CloningConfig
from svfl_models.cloning.data import CloningData
from svfl_models.cloning.loss import LOSSES as FUNCTIONS
from svfl_models.cloning.loss import action_error
from svfl_models.cloning.metrics import COLUMNS
from svfl_models.networks.action_space import PLANAR
from svfl_models.networks.squashed_gaussian import SquashedGaussian
from svfl_models.training import run_folder
from svfl_models.training.progress import MetricsFile
from tests.helpers.demonstrations import demonstrations

pytestmark = pytest.mark.slow

QUIET = Console(quiet=True)


@pytest.fixture(scope="module")
def config(tmp_path_factory):
    folder = demonstrations(tmp_path_factory.mktemp("data") / "picking")
    return CloningConfig(
        str(folder), episodes=6, preset="tiny", image_size=8, valid=1 / 3, epochs=3, batch_size=10, learning_rate=3e-3
    )


@pytest.fixture(scope="module")
def run(config, tmp_path_factory):
    out = tmp_path_factory.mktemp("run")
    return train.train_cloning(config, out, QUIET), out


def corners():
    """Actions on their bounds, all of them, and one in the middle."""
    signs = torch.cartesian_prod(*[torch.tensor([-1.0, 1.0])] * 5)
    return torch.tensor(PLANAR.centre) + torch.tensor(PLANAR.scale) * torch.cat([signs, torch.zeros(1, 5)])


def test_settings_of_the_training_have_their_effect(config, run, tmp_path):
    """Steps in the place of epochs, the course of the learning rate, the crop and the noise."""
    per_epoch = math.ceil(run[0].steps[0] / config.batch_size)
    by_steps = train.train_cloning(replace(config, steps=2 * per_epoch - 1), tmp_path / "steps", QUIET)
    assert by_steps.epochs == 2
    before = load_policy(run[1] / run_folder.CHECKPOINT).state_dict()
    for change in ({"schedule": "constant"}, {"crop": 1.0}, {"noise": 3.0}, {"widths": {"latent": 5}}):
        train.train_cloning(replace(config, **change), tmp_path / "other", QUIET)
        after = load_policy(tmp_path / "other" / run_folder.CHECKPOINT).state_dict()
        assert any(not torch.equal(after[name], before[name]) for name in before)
        (tmp_path / "other" / run_folder.CHECKPOINT).unlink()
        (tmp_path / "other" / run_folder.RESULT).unlink()


@pytest.mark.parametrize("name", LOSSES)
def test_actions_on_their_bounds_can_be_learned(name):
    """Descent comes near every corner, nothing grows without end, and no gradient is infinite."""
    action, loss = corners(), FUNCTIONS[name]
    mean, log_sigma = torch.zeros(33, 5, requires_grad=True), torch.zeros(33, 5, requires_grad=True)
    adam = torch.optim.Adam([mean, log_sigma], lr=0.05)
    for _ in range(1000):
        adam.zero_grad()
        value = loss(SquashedGaussian(mean, log_sigma), action).mean()
        value.backward()
        assert torch.isfinite(value)
        assert all(torch.isfinite(one.grad).all() for one in (mean, log_sigma) if one.grad is not None)
        adam.step()
    mode = SquashedGaussian(mean, log_sigma).mode.detach()
    assert ((mode - action).abs() / torch.tensor(PLANAR.scale) < 0.03).all()
    assert mean.abs().max() < 6


def test_a_gripper_is_a_probability():
    """The opening that a policy says is what cross-entropy takes it for."""
    mean = torch.linspace(-4, 4, 9)[:, None] * torch.tensor([1.0, 0, 0, 0, 0])
    said = SquashedGaussian(mean, torch.zeros(9, 5))
    opened = PLANAR.to_physical(torch.tensor([1.0, 0, 0, 0, 0]).expand(9, 5))
    torch.testing.assert_close(action_error(said, opened), -said.mode[:, 0].log(), atol=1e-6, rtol=1e-5)


def test_errors_count_in_units_of_the_bounds():
    action = PLANAR.to_physical(torch.tensor([[0.0, 0.3, 0.4, 0.0, 0.0]]))
    still = SquashedGaussian(torch.zeros(1, 5), torch.zeros(1, 5))
    torch.testing.assert_close(action_error(still, action), torch.tensor([np.log(2) + 0.25], dtype=torch.float32))


def test_a_run_leaves_what_it_found(run, config):
    result, out = run
    rows = list(csv.DictReader((out / run_folder.METRICS).open()))
    assert tuple(rows[0]) == COLUMNS
    assert [row["epoch"] for row in rows] == ["0", "1", "2"]
    assert float(rows[-1]["train_loss"]) < float(rows[0]["train_loss"])
    found = json.loads((out / run_folder.RESULT).read_text())
    assert found["config"] == config.plain()
    assert found["deployment"]["task"] == "block_picking"
    assert (result.episodes, result.steps, result.epochs) == ([4, 2], [24, 12], 3)
    assert result.valid_loss == pytest.approx(float(rows[-1]["valid_loss"]), rel=1e-5)


def test_a_run_has_a_report_and_learning_curves(run, config):
    result, out = run
    said = (out / run_folder.REPORT).read_text()
    assert "# Behaviour cloning: block_picking, V+F+P SVFL, 6 demonstrations" in said
    assert "2 held-out demonstrations (12 steps)" in said
    assert f"| (dx, dy) off | {result.valid_xy_mm:.1f} mm |" in said
    assert f"| epochs | {config.epochs} |" in said
    assert plt.imread(out / run_folder.LEARNING_CURVE)[..., :3].std() > 0.05


@pytest.mark.parametrize(("losses", "risen"), [([3, 2, 1], False), ([3, 1, 1.05], False), ([3, 1, 2], True)])
def test_a_report_says_whether_the_held_out_loss_has_risen(run, config, losses, risen):
    result, _ = run
    history = [{"epoch": epoch, "valid_loss": loss} for epoch, loss in enumerate(losses)]
    said = report.page(config, "picking", result, history)
    assert ("was lowest after 2 epochs (1) and has risen to 2 since" in said) == risen


def test_a_report_names_only_the_errors_that_an_action_has(run, config):
    result, _ = run
    own = replace(result, valid_gripper=None, valid_xy_mm=None, valid_z_mm=None, valid_turn_deg=None)
    said = report.page(replace(config, inputs=["cameras/front"], rotate=True, group="none"), "wiping", own, [])
    assert "own inputs CNN, rotated samples" in said
    assert "gripper" not in said.split("| setting")[0]
    assert "action off, mean over its components" in said


def test_scales_come_from_the_training_episodes_alone(run, config):
    _, out = run
    fitted = load_policy(out / run_folder.CHECKPOINT).policy.trunk.normalization
    seen = CloningData(config).train_set.typical()
    torch.testing.assert_close(fitted.wrench_mean[2], seen["wrench"][..., 2].mean())
    torch.testing.assert_close(fitted.image_mean, seen["image"].mean(dim=(0, 2, 3)))
    torch.testing.assert_close(fitted.proprio_mean[3], seen["proprio"][:, 3].mean())


def weights(out):
    return torch.load(out / run_folder.CHECKPOINT, weights_only=True)


def stop_in_the_second_epoch(self, trainer, *rest):
    """Ctrl-C, in the middle of it."""
    if trainer.current_epoch == 1:
        raise KeyboardInterrupt


@pytest.mark.parametrize("encoder", ["vfp", "p"])
def test_an_interruption_leaves_no_trace(encoder, config, tmp_path, monkeypatch):
    config = replace(config, encoder=encoder)
    train.train_cloning(config, tmp_path / "whole", QUIET)
    with monkeypatch.context() as patched:
        patched.setattr(MetricsFile, "on_train_batch_end", stop_in_the_second_epoch)
        with pytest.raises(KeyboardInterrupt):
            train.train_cloning(config, tmp_path / "cut", QUIET)
    assert not (tmp_path / "cut" / run_folder.RESULT).exists()
    torch.rand(17)
    result = train.train_cloning(config, tmp_path / "cut", QUIET)
    assert result.epochs == 3
    whole, cut = weights(tmp_path / "whole"), weights(tmp_path / "cut")
    for name, values in whole["state_dict"].items():
        assert torch.equal(values, cut["state_dict"][name]), name
    states = [one["optimizer_states"][0]["state"] for one in (whole, cut)]
    for index, state in states[0].items():
        assert all(torch.equal(values, states[1][index][name]) for name, values in state.items())
    rows = [[line.split(",")[:-1] for line in (tmp_path / name / "metrics.csv").open()] for name in ("whole", "cut")]
    assert rows[0] == rows[1]


def test_another_configuration_does_not_go_on_there(run, config):
    _, out = run
    with pytest.raises(TrainingError, match=r"epochs = 3\b.* 4\b"):
        train.train_cloning(replace(config, epochs=4), out, QUIET)


def test_a_damaged_checkpoint_is_said_before_training_goes_on(config, tmp_path):
    run_folder.claim(tmp_path / "run", "bc", config.plain())
    (tmp_path / "run" / run_folder.CHECKPOINT).write_text("half a file")
    with pytest.raises(FormatError, match=r"checkpoint\.ckpt"):
        train.train_cloning(config, tmp_path / "run", QUIET)


def test_a_training_that_diverges_says_so(config, tmp_path):
    with pytest.raises(TrainingError, match=r"learning rate .*1e\+30"):
        train.train_cloning(replace(config, encoder="p", learning_rate=1e30), tmp_path / "run", QUIET)


def test_a_checkpoint_says_what_it_is(run, tmp_path):
    _, out = run
    module = load_policy(out / run_folder.CHECKPOINT)
    assert (module.deployment.task, module.deployment.switch, module.training) == ("block_picking", True, False)
    found = weights(out)
    other = tmp_path / "other.ckpt"
    for change, facts in (
        ({"svfl": {"format": "svfl-centering"}}, "svfl-centering.* svfl-policy"),
        ({"svfl": None}, "svfl-policy"),
        ({"svfl": found["svfl"] | {"format_version": "2.0"}}, r" 2\.0\b.* 1\.0\b"),
        ({"state_dict": {}}, "do not fit"),
        ({"hyper_parameters": found["hyper_parameters"] | {"loss": "x"}}, "loss 'x'"),
    ):
        torch.save(found | change, other)
        with pytest.raises(FormatError, match=facts):
            load_policy(other)
    with pytest.raises(FormatError, match=r"nothing\.ckpt"):
        load_policy(tmp_path / "nothing.ckpt")


def command(*arguments):
    try:
        return cli.main([*map(str, arguments)])
    except SystemExit as stop:
        return stop.code


def test_the_command(config, tmp_path, capsys):
    out = tmp_path / "run"
    small = ("--preset", "tiny", "--image-size", 8, "--epochs", 1, "--encoder", "p", "--out", out)
    assert command("bc", "--data", config.data, "--episodes", 6, "--model", "cnn", *small) == 0
    printed = capsys.readouterr().out
    assert "learned 30 steps of 5 episodes" in printed
    assert f"svfl-train evaluate {out / 'checkpoint.ckpt'}" in printed
    assert load_policy(out / "checkpoint.ckpt").policy.group.name == "none"


@pytest.mark.parametrize(
    ("arguments", "code", "facts"),
    [
        (["--encoder", "fp"], 2, "--encoder.* 'fp'"),
        (["--model", "cnn", "--group", "D8"], 2, "--model cnn.* --group D8"),
        (["--loss", "l1"], 2, "--loss.* 'l1'"),
        ([], 1, " 50 successful episodes.* 6 among 6"),
    ],
)
def test_mistakes_are_one_line(arguments, code, facts, config, tmp_path, capsys):
    assert command("bc", "--data", config.data, "--out", tmp_path / "run", *arguments) == code
    error = capsys.readouterr().err
    assert re.search(facts, error)
    assert error.count("\n") == 1
    assert not (tmp_path / "run").exists()


def test_the_command_line_loads_no_torch():
    code = "import sys, svfl_models.cli as c; c.build_parser(); print('torch' in sys.modules, 'escnn' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "False"]
