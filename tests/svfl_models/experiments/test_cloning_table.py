"""The table of clonings: every policy once, in any number of sittings, and a page that says what was found."""

import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import replace

import pytest

from svfl_data.datasets.dataset import Dataset
from svfl_data.datasets.fingerprint import identity
from svfl_data.errors import DatasetError, StorageError, TrainingError
from svfl_models import cli
from svfl_models.cloning import evaluate, train
from svfl_models.cloning.config import CloningConfig
from svfl_models.cloning.evaluate import Evaluation
from svfl_models.commands import bc_table
from svfl_models.configuration.program import command_line
from svfl_models.experiments import cloning_table, cloning_table_page
from svfl_models.experiments.cloning_table import Table
from svfl_models.experiments.runs.folder import held
from svfl_models.experiments.runs.grid import Grid
from svfl_models.training import run_folder
from svfl_models.training.progress import MetricsFile
from svfl_models.training.provenance.record import record, recorded
from svfl_models.training.provenance.session import Session
from tests.helpers.demonstrations import demonstrations
from tests.helpers.experiment_pages import pretend, tell
from tests.helpers.patience import PATIENCE
from tests.helpers.pretend import is_running
from tests.helpers.pretend_cloning import Diverging, Endless, Quick

pytestmark = pytest.mark.slow

TRIALS = 4
BASE = CloningConfig("", preset="tiny", epochs=2)
ENDLESS = f"""
import sys
from svfl_models import cli
from svfl_models.experiments import cloning_table
from {Endless.__module__} import Endless
cloning_table.Run = Endless
sys.exit(cli.main(sys.argv[1:]))
"""


@pytest.fixture
def runs(tmp_path):
    return cloning_table.runs(BASE, ["data/picking", "data/pushing"], [5, 10], 2, TRIALS, tmp_path / "out")


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    return demonstrations(tmp_path_factory.mktemp("data") / "block_picking")


@pytest.fixture
def one(data, tmp_path):
    """A policy that can really be trained, of little."""
    base = replace(BASE, encoder="p", epochs=3)
    return cloning_table.runs(base, [str(data)], [6], 1, TRIALS, tmp_path / "out")[0]


@pytest.fixture
def tried(monkeypatch):
    """Policies are not tried in simulation, but said to succeed always."""
    monkeypatch.setattr(
        evaluate, "evaluate", lambda checkpoint, trials, **_: Evaluation("", "", 0, [True] * trials, [1] * trials)
    )


def words(data, out, *more):
    few = ("--episodes", 6, "--seeds", 2, "--test-episodes", TRIALS, "--preset", "tiny", "--epochs", 2)
    few += ("--networks", "svfl", "cnn")
    return [str(word) for word in ("bc-table", "--data", data, *few, "--out", out, *more)]


def written(out):
    return {file.parent.name: file.stat().st_mtime_ns for file in out.glob("runs/*/evaluation.json")}


def test_every_combination_is_there_once_and_seeds_come_in_turn(runs):
    assert len(runs) == len({run.folder for run in runs}) == 2 * 2 * 2 * 3
    assert [run.config.seed for run in runs] == [0] * 12 + [1] * 12
    assert {(run.task, run.network, run.config.episodes) for run in runs} == {
        (task, network, count)
        for task in ("picking", "pushing")
        for network in ("svfl", "cnn", "cnn-rotated")
        for count in (5, 10)
    }
    assert {(run.network, run.config.model, run.config.rotate) for run in runs} == {
        ("svfl", "svfl", False), ("cnn", "cnn", False), ("cnn-rotated", "cnn", True)
    }  # fmt: skip


def test_fewer_demonstrations_train_for_as_many_steps(runs):
    assert {run.config.epochs * run.config.episodes for run in runs} == {BASE.epochs * 10}


def test_what_is_finished_is_not_done_again_and_the_order_is_kept(runs, tmp_path):
    for run in runs[:3]:
        pretend(run)
    assert Grid(tmp_path, {run.folder.name: run for run in runs}).unfinished() == [run.folder.name for run in runs[3:]]
    assert replace(runs[0], test_episodes=TRIALS + 1).outcome() is None  # tried less often than is asked for now


@pytest.mark.parametrize("finished", [True, False])
def test_a_run_of_another_configuration_is_refused(runs, finished):
    if finished:
        pretend(runs[0])
    else:
        run_folder.claim(runs[0].folder, "bc", runs[0].config.plain())
    other = replace(runs[0], config=replace(runs[0].config, epochs=7))
    with pytest.raises(TrainingError, match=f"{runs[0].folder} .*--out"):
        other.words()


def test_tasks_are_told_by_their_names(tmp_path, capsys):
    assert cli.main(words(tmp_path / "a" / "picking", tmp_path / "out", "--data", "a/picking", "b/picking")) == 2
    assert re.search("--data .*picking", capsys.readouterr().err)


def test_an_interrupted_policy_goes_on_after_its_last_whole_epoch(one, tried, monkeypatch):
    def stop_in_the_second_epoch(self, trainer, *_):
        if trainer.current_epoch == 1:
            raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(MetricsFile, "on_train_batch_end", stop_in_the_second_epoch)
        with pytest.raises(KeyboardInterrupt):
            one()
    assert one.words() is None
    epochs = []
    monkeypatch.setattr(
        MetricsFile, "on_train_epoch_start", lambda self, trainer, *_: epochs.append(self.rows[-1]["epoch"])
    )
    one()
    assert epochs == [0, 1]
    assert one.words() == "100% of 4"
    replace(one, test_episodes=6)()
    assert len(epochs) == 2  # more test episodes need no training
    assert replace(one, test_episodes=6).words() == "100% of 6"


@pytest.mark.parametrize(
    ("error", "told"), [(DatasetError, TrainingError), (TrainingError, TrainingError), (StorageError, StorageError)]
)
def test_what_is_wrong_with_one_dataset_is_nothing_to_the_others(one, monkeypatch, error, told):
    def fail(*_):
        raise error("for a reason")

    monkeypatch.setattr(train, "train_cloning", fail)
    with pytest.raises(told, match="for a reason"):
        one()


def test_a_failing_policy_is_named_and_the_others_are_done(data, tmp_path, monkeypatch, capsys):
    out, name = tmp_path / "out", "block_picking_vfp_cnn_6_seed0"
    monkeypatch.setattr(cloning_table, "Run", Diverging)
    assert cli.main(words(data, out)) == 1
    said = capsys.readouterr()
    assert re.match(f"svfl-train: 1 of 4 .*{name}: the training diverged", said.err.splitlines()[-1])
    assert "4 policies, 3 of them finished" in said.out
    assert said.out.startswith((out / "bc_table.md").read_text().strip())
    first = written(out)
    assert len(first) == 3
    monkeypatch.setattr(cloning_table, "Run", Quick)
    assert cli.main(words(data, out)) == 0
    assert f"4/4 {name}: 25% of 4" in capsys.readouterr().err
    assert first.items() < written(out).items()


def test_two_tables_in_one_folder_are_one_too_many(data, tmp_path, capsys):
    with held(tmp_path / "out"):
        assert cli.main(words(data, tmp_path / "out")) == 1
    said = capsys.readouterr().err
    assert said.startswith(f"svfl-train: {tmp_path / 'out'}: another process")
    assert said.count("\n") == 1
    assert os.listdir(tmp_path / "out" / "runs") == []


def test_data_are_needed_for_what_is_unfinished_only(data, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(cloning_table, "Run", Quick)
    gone = tmp_path / "block_picking"
    assert cli.main(words(gone, tmp_path / "out")) == 1
    said = capsys.readouterr().err
    assert said.startswith(f"svfl-train: {gone}: ")
    assert said.count("\n") == 1
    assert not (tmp_path / "out").exists()
    for run in cloning_table.runs(BASE, [str(gone)], [6], 2, TRIALS, tmp_path / "out", ("svfl", "cnn")):
        run()
    assert cli.main(words(gone, tmp_path / "out")) == 0
    assert "4 policies, 4 of them finished" in capsys.readouterr().out


def test_a_table_that_is_told_to_end_leaves_no_process(data, tmp_path):
    out = tmp_path / "out"
    command = subprocess.Popen(
        [sys.executable, "-c", ENDLESS, *words(data, out, "--workers", 2)], stderr=subprocess.PIPE, text=True
    )
    while len(begun := list(out.glob(f"runs/*/{run_folder.CHECKPOINT}"))) < 2:
        assert command.poll() is None
        time.sleep(0.02)
    command.send_signal(signal.SIGTERM)
    _, complaint = command.communicate(timeout=PATIENCE)
    assert complaint == "svfl-train: interrupted; everything finished so far is on disk\n"
    assert command.returncode == 128 + signal.SIGTERM
    assert "4 policies, 0 of them finished" in (out / "bc_table.md").read_text()
    assert not any(is_running(file.read_text()) for file in begun)  # and the file is still there, to go on from


def page_of(runs, out):
    out.mkdir(exist_ok=True)
    page, files = cloning_table_page.write(Table(runs), "svfl-train bc-table", out)
    assert all(file.stat().st_size for file in files)
    return page


@pytest.mark.parametrize("finished", [0, 7, 24])
def test_the_page_says_what_is_known(runs, tmp_path, finished):
    for run in runs[:finished]:
        pretend(run)
    page = page_of(runs, tmp_path / "out")
    assert f"24 policies, {finished} of them finished: seeds 0 to 1;" in page
    assert page.count("| picking | 10 | SVFL | 75.0% |") == (1 if finished else 0)
    assert page.count("| pushing | 10 | SVFL minus CNN | +50 |") == (finished == 24)
    assert page.count("| pushing | 10 | SVFL minus CNN, rotated and mirrored samples | +50 |") == (finished == 24)
    assert ("## All tasks" in page) == (finished > 0)
    assert ("No policy has been evaluated" in page) == (finished == 0)
    assert ("spread between seeds is unknown" in page) == (finished == 7)
    assert ("seeds and scenes are resampled" in page) == (finished == 24)
    assert (
        "The success rate is lower" not in page
    )  # the pretended results do not depend on the number of demonstrations


@pytest.mark.parametrize(
    ("fewer", "more", "told"), [([4, 4, 4], [0, 0, 0], "picking CNN 10 minus 5"), ([4, 0, 3], [1, 2, 2], "none")]
)
def test_the_page_says_which_decreases_are_significant(tmp_path, fewer, more, told):
    runs = cloning_table.runs(BASE, ["data/picking"], [5, 10], 3, TRIALS, tmp_path / "out", ["cnn"])
    for run in runs:
        count = (fewer if run.config.episodes == 5 else more)[run.config.seed]
        tell(run, *[index < count for index in range(TRIALS)])
    page = page_of(runs, tmp_path / "out")
    assert f"The success rate is lower with more demonstrations in 1 of 1 case; significant: {told}." in page
    assert "SVFL" not in page
    assert "all networks" not in page


def test_the_seeds_of_a_row_are_seen(tmp_path):
    runs = cloning_table.runs(BASE, ["data/picking"], [5], 1, TRIALS, tmp_path / "out", ["svfl", "cnn"])
    for run in runs:
        tell(run, True, True, False, False)
    page = page_of(runs, tmp_path / "out")
    assert "| picking | 5 | SVFL | 50.0% | 15% to 85% | 50% |" in page
    assert "unknown (one seed)" in page
    assert "seed 0;" in page


def test_the_page_says_where_the_policies_and_their_data_come_from(data, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(cloning_table, "Run", Quick)
    out, sha256 = tmp_path / "out", identity(Dataset.open(data)).sha256
    for starts in (1, 2):
        assert cli.main(words(data, out)) == 0
        assert [one.data["block_picking"].sha256 for one in recorded(out)] == [sha256] * starts
    page = capsys.readouterr().out
    assert "## Provenance" in page
    assert f"6 episodes, SHA-256 {sha256[:12]} over the seals" in page
    assert "4 runs: unknown provenance" in page  # Quick trains nothing
    for run in (out / "runs").iterdir():
        record(run, Session("", commit="a" * 40, clean=False))
    assert cli.main(words(data, out)) == 0
    assert f"4 runs: commit {'a' * 12} (not clean)" in capsys.readouterr().out


def test_the_command_line_is_what_gives_the_numbers():
    given = (
        "bc-table --data a b --episodes 10 50 --seeds 2 --test-episodes 20 --epochs 7 --view camera "
        "--set widths.latent=9"
    )
    seen = []
    program = replace(bc_table.PROGRAM, run=lambda values, _: seen.append(values))
    arguments = cli.build_parser().parse_args([*given.split(), "--workers", "3", "--out", "c"])
    program.start(arguments)
    words = command_line("bc-table", seen[0], program.settings).split()
    assert words[0] == "svfl-train"
    program.start(cli.build_parser().parse_args(words[1:]))
    assert seen[0] == seen[1]
    assert "--workers" not in words
    assert "--valid" not in words
