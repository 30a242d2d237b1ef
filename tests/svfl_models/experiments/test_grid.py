import json
import multiprocessing
import os
import re
import signal
import subprocess
import sys
import time

import pytest
from rich.console import Console

from svfl_data.errors import DatasetError, TrainingError
from svfl_models.centering.config import TrainingConfig
from svfl_models.experiments.runs.cost import cost
from svfl_models.experiments.runs.folder import claimed
from svfl_models.experiments.runs.grid import Grid
from svfl_models.experiments.runs.job import devices
from svfl_models.experiments.runs.progress_bar import Bar
from svfl_models.experiments.runs.training import Training, run_name
from tests.helpers import pretend
from tests.helpers.patience import PATIENCE
from tests.helpers.pretend import is_running

pytestmark = pytest.mark.slow

BASE = TrainingConfig("data")
QUIET = Console(quiet=True)
FOR_EVER = """
import pathlib, sys
from rich.console import Console
from svfl_data.system import command_line
from svfl_models.experiments.runs import grid
from tests.svfl_models.experiments import test_grid
from tests.helpers import pretend

grid.devices = lambda: [None]  # torch takes seconds to import
jobs = test_grid.jobs(pathlib.Path(sys.argv[1]), test_grid.runs(0, 1, 2), pretend.train_for_ever)
sys.exit(command_line.run(lambda: grid.Grid(pathlib.Path(sys.argv[1]), jobs).run(2, Console(quiet=True)), "svfl"))
"""


def runs(*seeds):
    return {f"seed{seed}": TrainingConfig("data", seed=seed) for seed in seeds}


def jobs(out, configs, train=pretend.train):
    return {name: Training(config, out / "runs" / name, train=train) for name, config in configs.items()}


def grid_of(out, configs, train=pretend.train):
    return Grid(out, jobs(out, configs, train))


def results(out):
    return {file.parent.name: file.stat().st_mtime_ns for file in out.glob("runs/*/result.json")}


def test_every_run_is_done_once(tmp_path):
    grid = grid_of(tmp_path, runs(0, 1, 2))
    grid.run(2, QUIET)
    first = results(tmp_path)
    assert set(first) == {"seed0", "seed1", "seed2"}
    grid.run(2, QUIET)
    assert results(tmp_path) == first
    grid_of(tmp_path, runs(0, 1, 2, 3)).run(2, QUIET)
    again = results(tmp_path)
    assert set(again) - set(first) == {"seed3"}
    assert {name: again[name] for name in first} == first


def test_half_a_run_is_none(tmp_path):
    (tmp_path / "runs" / "seed0").mkdir(parents=True)
    (tmp_path / "runs" / "seed0" / "result.json").write_text('{"config": {"da')
    (tmp_path / "runs" / "seed0" / "checkpoint.ckpt").write_text("half")
    grid = grid_of(tmp_path, runs(0))
    assert grid.unfinished() == ["seed0"]
    grid.run(1, QUIET)
    assert grid.unfinished() == []
    assert not (tmp_path / "runs" / "seed0" / "checkpoint.ckpt").exists()


def test_a_finished_run_of_another_configuration_is_not_taken_for_this_one(tmp_path):
    grid_of(tmp_path, runs(0)).run(1, QUIET)
    with pytest.raises(TrainingError, match=r"seed0 .*--out"):
        grid_of(tmp_path, {"seed0": TrainingConfig("data", epochs=7)}).unfinished()


def test_accidents_cost_their_own_run_only(tmp_path):
    grid = grid_of(tmp_path, runs(2, 1, 3, 0, 4), pretend.train_with_accidents)
    grid.run(1, QUIET)
    assert set(results(tmp_path)) == {"seed0", "seed4"}
    assert grid.failed == {
        "seed1": "the train loss became nan",
        "seed2": f"its process died with exit code 9, see {tmp_path / 'workers.log'}",
        "seed3": "ZeroDivisionError: two lines",
    }
    assert "train_with_accidents" in (tmp_path / "workers.log").read_text()  # where our own mistake was made


def test_failures_are_named_with_their_reasons(tmp_path):
    grid = grid_of(tmp_path, runs(*range(6)))
    grid.raise_failures()  # there is none
    grid.failed = {f"seed{seed}": "it diverged" for seed in range(5)}
    told = "seed0: it diverged; seed1: it diverged; seed2: it diverged; and 2 more"
    with pytest.raises(TrainingError, match=f"5 of 6 .*{told}"):
        grid.raise_failures()


def test_what_befalls_every_run_ends_it_all(tmp_path):
    with pytest.raises(DatasetError, match="the dataset has no labels"):
        grid_of(tmp_path, runs(0, 1, 2), pretend.train_without_data).run(2, QUIET)
    assert multiprocessing.active_children() == []


def test_ctrl_c_keeps_what_is_finished_and_waits_for_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(Bar, "ended", lambda *arguments: signal.raise_signal(signal.SIGINT))
    grid = grid_of(tmp_path, runs(0, 1, 2), pretend.train_seed_0_only)
    with pytest.raises(KeyboardInterrupt):
        grid.run(2, QUIET)
    assert multiprocessing.active_children() == []
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    assert set(results(tmp_path)) == {"seed0"}
    assert sorted(grid.unfinished()) == ["seed1", "seed2"]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_whatever_ends_an_experiment_ends_its_workers(tmp_path, number):
    command = subprocess.Popen(
        [sys.executable, "-c", FOR_EVER, tmp_path], start_new_session=True, stderr=subprocess.PIPE, text=True
    )
    while len(begun := list(tmp_path.glob("runs/*/process"))) < 2:
        assert command.poll() is None
        time.sleep(0.02)
    if number == signal.SIGINT:
        os.killpg(command.pid, number)  # as a terminal does: workers are told, too
    else:
        command.send_signal(number)
    _, complaint = command.communicate(timeout=PATIENCE)
    if number == signal.SIGINT:
        assert command.returncode == 128 + number
        assert complaint == "svfl: interrupted; everything finished so far is on disk\n"
    deadline = time.monotonic() + PATIENCE
    while any(is_running(file.read_text()) for file in begun):
        assert time.monotonic() < deadline
        time.sleep(0.02)
    assert (tmp_path / "workers.log").read_text() == ""


def test_the_longest_runs_come_first(tmp_path):
    configs = {
        "f": TrainingConfig("data", encoder="f"),
        "vf": TrainingConfig("data", encoder="vf"),
        "v8": TrainingConfig("data", encoder="v", image_size=8),
        "v": TrainingConfig("data", encoder="v"),
        "few": TrainingConfig("data", encoder="vf", train_samples=10),
        "D8": TrainingConfig("data", encoder="vf", group="D8"),
        "cnn": TrainingConfig("data", encoder="vf", group="none"),
    }
    order = grid_of(tmp_path, configs).unfinished()
    assert order[:3] == ["D8", "vf", "v"]
    assert order[-1] == "few"
    assert all(cost(config) > 0 for config in configs.values())


def test_names_tell_what_is_special():
    assert run_name(BASE, BASE) == "vf_D4_100_seed0"
    special = TrainingConfig("data", encoder="f", noise=3.0, torque="polar", seed=2)
    assert run_name(special, BASE) == "f_D4_100_torque-polar_noise-3.0_seed2"


def test_progress(tmp_path):
    configs = jobs(tmp_path, runs(0, 1, 2))
    terminal, paper = Console(force_terminal=True, record=True, width=120), Console(record=True, width=40)
    for console in (terminal, paper):
        with Bar(configs, ["seed1", "seed2"], console) as bar:
            bar.ended("seed1", "test accuracy 97.0%")
    assert re.search(r"runs [━╸╺]+ 2/3 seed1: test accuracy 97\.0% ", terminal.export_text())
    assert paper.export_text() == "2/3 seed1: test accuracy 97.0%\n"


@pytest.mark.parametrize(
    ("count", "variable", "found"),
    [(0, None, [None]), (2, None, ["0", "1"]), (2, "3,5", ["3", "5"]), (0, "", [None])],
)
def test_gpus_take_turns(count, variable, found, monkeypatch):
    monkeypatch.setattr("torch.cuda.device_count", lambda: count)
    monkeypatch.delenv("CUDA_VISIBLE_DEVICES", raising=False)
    if variable is not None:
        monkeypatch.setenv("CUDA_VISIBLE_DEVICES", variable)
    assert devices() == found


def test_a_worker_sees_its_own_gpu_only(tmp_path, monkeypatch):
    monkeypatch.setattr("svfl_models.experiments.runs.grid.devices", lambda: ["4", "6"])
    grid_of(tmp_path, runs(0, 1, 2), pretend.train_and_tell).run(3, QUIET)
    seen = sorted(file.read_text() for file in tmp_path.glob("runs/*/device"))
    assert seen == ["4 torch: False", "4 torch: False", "6 torch: False"]


def test_a_folder_belongs_to_one_experiment_and_one_process(tmp_path):
    about = {"experiment": "centering-table", "recipe": {"epochs": 2}, "data": None, "separate_test": None}
    out = tmp_path / "out"
    busy = pytest.raises(TrainingError, match="another process")
    with claimed(out, about), busy, claimed(out, about):
        pass
    with claimed(out, about):
        assert json.loads((out / "experiment.json").read_text()) == about
    (out / "runs" / "one").mkdir()
    with claimed(out, about | {"separate_test": {"path": "right"}}):  # nobody has finished a run with the wrong one
        pass
    with claimed(out, about):
        (out / "runs" / "one" / "result.json").write_text('{"config": {}, "result": {}}')
    other = about | {"experiment": "centering-groups"}
    facts = "experiment 'centering-table'.* 'centering-groups'"
    with pytest.raises(TrainingError, match=facts), claimed(out, other):
        pass
    with pytest.raises(TrainingError, match=r"epochs = 2.* 3"), claimed(out, about | {"recipe": {"epochs": 3}}):
        pass
    (tmp_path / "mine").write_text("")
    with pytest.raises(TrainingError, match=r"no experiment\.json"), claimed(tmp_path, about):
        pass
