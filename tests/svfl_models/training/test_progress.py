"""Progress of trainings: a whole line at 80 columns with the time left, and nothing for who wants it quiet."""

import io
import re
from types import SimpleNamespace

import pytest
import torch
from rich.console import Console

from svfl_data.system.progress import quiet
from svfl_models.cloning.metrics import CloningProgress
from svfl_models.experiments.runs.progress_bar import Bar
from svfl_models.latent import progress as latent
from svfl_models.training import progress
from svfl_models.training.progress import ProgressLine

METRICS = {
    "train_loss": 1.234567, "test_accuracy": 1.0, "valid_loss": -12.3456, "valid_xy_mm": 123.456, "valid_error": 0.5,
}  # fmt: skip


def trainer(epoch):
    return SimpleNamespace(
        current_epoch=epoch, callback_metrics={name: torch.tensor(value) for name, value in METRICS.items()}
    )


def terminal(width=80):
    return Console(file=io.StringIO(), force_terminal=True, width=width, height=25)


def last_line(console):
    text = re.sub(r"\x1b\[\?25[hl]|\x1b\[[0-9;]*m", "", console.file.getvalue())
    return [line for line in re.split(r"[\r\n]|\x1b\[[0-9;]*[A-Za-z]", text) if line.strip()][-1]


@pytest.mark.parametrize(("kind", "said"), [
    (ProgressLine, "loss 1.235, test accuracy 100.0%, best 100.0%"),
    (CloningProgress, "loss 1.235, held out -12.346, 123.5 mm"),
])  # fmt: skip
def test_epochs(kind, said):
    console = terminal()
    bar = kind(500, console)
    bar.on_fit_start(trainer(0), None)
    for epoch in (0, 249):
        bar.on_train_epoch_end(trainer(epoch), None)
    bar.on_fit_end(trainer(249), None)
    line = last_line(console)
    assert len(line) <= 80
    assert re.fullmatch(rf"epoch [━╸╺]+ +250/500 {re.escape(said)} [-\d:]+ left\s*", line)


def test_steps(monkeypatch):
    console, done = terminal(), [1]
    monkeypatch.setattr(latent, "steps_of", lambda module: done[0])
    bar = latent.StepsBar(10_000, console)
    bar.on_train_start(trainer(0), None)
    done[0] = 5000
    bar.on_train_batch_end(trainer(0), None)
    bar.on_train_epoch_end(trainer(0), None)
    bar.on_fit_end(trainer(0), None)
    line = last_line(console)
    assert len(line) <= 80
    assert re.fullmatch(r"step [━╸╺]+ +5000/10000 loss 1\.235, held out -12\.35 [-\d:]+ left\s*", line)


@pytest.mark.parametrize("wanted", [True, False])
def test_quiet_trainings_say_nothing(wanted, monkeypatch):
    monkeypatch.setattr(progress, "QUIET_SECONDS", 0.0)
    for console in (terminal(), Console(file=io.StringIO(), width=80)):
        monkeypatch.setattr("svfl_data.system.progress.bars.progress_console", lambda: Console(quiet=True))
        with quiet(wanted):
            for bar in (ProgressLine(3, console), CloningProgress(3, console)):
                bar.on_fit_start(trainer(0), None)
                bar.on_train_epoch_end(trainer(0), None)
                bar.on_fit_end(trainer(0), None)
            with Bar({"one": SimpleNamespace(cost=1.0)}, ["one"], console) as runs:
                runs.ended("one", "test accuracy 97.0%")
        assert bool(console.file.getvalue()) is not wanted
