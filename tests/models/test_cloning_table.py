"""The table of clonings: every policy once, in any number of sittings, and a page that says what was found."""

import json

import pytest
from rich.console import Console

from svfl_data.errors import TrainingError
from svfl_models import run_folder
from svfl_models.cli import build_parser
from svfl_models.cloning import table, table_page
from svfl_models.cloning.config import CloningConfig
from svfl_models.cloning.evaluate import wilson
from svfl_models.cloning.table import Rate

TRIALS = 4
BASE = CloningConfig("", preset="tiny", epochs=2)
SUCCESS = {"svfl": [True, True, True, False], "cnn": [True, False, False, False]}


def pretend(run):
    """What a finished run leaves."""
    run.folder.mkdir(parents=True)
    figures = {
        "valid_gripper": 0.01,
        "valid_xy_mm": 4.0,
        "valid_z_mm": 3.0,
        "seconds": 10.0,
        "parameters": 5,
        "epochs": 2,
    }
    (run.folder / run_folder.RESULT).write_text(json.dumps({"config": run.config.plain(), "result": figures}))
    (run.folder / run_folder.EVALUATION).write_text(json.dumps({"success": SUCCESS[run.config.model]}))
    (run.folder / run_folder.METRICS).write_text("epoch,train_loss,valid_loss\n0,1.0,1.1\n1,0.5,0.7\n")


@pytest.fixture
def runs(tmp_path):
    return table.runs(BASE, ["data/picking", "data/pushing"], [5, 10], 2, tmp_path / "out")


def test_every_combination_is_there_once_and_seeds_come_in_turn(runs):
    assert len(runs) == len({run.folder for run in runs}) == 2 * 2 * 2 * 2
    assert [run.config.seed for run in runs] == [0] * 8 + [1] * 8
    assert {(run.task, run.config.model, run.config.episodes) for run in runs} == {
        (task, model, count) for task in ("picking", "pushing") for model in ("svfl", "cnn") for count in (5, 10)
    }


def test_fewer_demonstrations_train_for_as_many_steps(runs):
    assert {run.config.epochs * run.config.episodes for run in runs} == {BASE.epochs * 10}


def test_what_is_finished_is_not_done_again(runs, monkeypatch):
    for run in runs[:3]:
        pretend(run)
    asked = []
    monkeypatch.setattr(table, "_done", lambda waiting, *_: asked.extend(waiting) or [])
    table.complete(runs, TRIALS, 1, Console(quiet=True))
    assert asked == runs[3:]
    assert runs[0].outcome(TRIALS + 1) is None  # tried less often than is asked for now


def test_a_run_of_another_configuration_is_refused(runs, tmp_path):
    pretend(runs[0])
    (other,) = table.runs(CloningConfig("", preset="wide", epochs=2), ["data/picking"], [5], 1, tmp_path / "out")[:1]
    with pytest.raises(TrainingError, match="holds a run with another configuration"):
        other.outcome(TRIALS)


def test_rates_of_seeds_are_pooled():
    rate = Rate.of([{"success": SUCCESS["svfl"]}, {"success": SUCCESS["cnn"]}])
    assert (rate.share, rate.by_seed) == (0.5, [0.75, 0.25])
    assert rate.interval == wilson(4, 8)
    assert rate.interval[0] < 0.5 < rate.interval[1]


@pytest.mark.parametrize("finished", [0, 5, 16])
def test_the_page_says_what_is_known(runs, tmp_path, finished):
    for run in runs[:finished]:
        pretend(run)
    (tmp_path / "out").mkdir(exist_ok=True)
    words, files = table_page.write(table_page.Table(runs, TRIALS), "svfl-train bc-table", tmp_path / "out")
    assert all(file.stat().st_size for file in files)
    assert f"16 policies, {finished} of them finished" in words
    assert words.count("| picking | 10 | SVFL | 75.0% |") == (1 if finished else 0)
    assert ("pushing +50 points" in words) == (finished == 16)


def test_the_command_line_is_what_gives_the_numbers():
    from svfl_models.verbs.bc_table import _command_line

    words = "bc-table --data a b --episodes 10 50 --seeds 2 --trials 20 --view camera --epochs 7 --workers 3 --out c"
    arguments = build_parser().parse_args(words.split())
    assert (
        _command_line(arguments)
        == "svfl-train bc-table --data a b --episodes 10 50 --seeds 2 --trials 20 --view camera --epochs 7"
    )
