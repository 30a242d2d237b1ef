import csv
import functools
import json
import re
import signal
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib import pyplot as plt

from svfl_data.datasets.dataset import Dataset
from svfl_data.storage.store import write_episode
from svfl_models import cli
from svfl_models.centering.config import TrainingConfig
from svfl_models.commands.experiments import COMMANDS
from svfl_models.experiments import command, page, table
from svfl_models.experiments.error_analysis import Predictions
from svfl_models.experiments.results import Cell, Mean, Results, Run
from svfl_models.experiments.runs.progress_bar import Bar
from svfl_models.experiments.runs.training import Training
from svfl_models.latent.config import MODELS
from svfl_models.training.provenance.record import recorded
from tests.helpers import pretend
from tests.helpers.builders import make_episode
from tests.helpers.pretrained import write_latent

pytestmark = pytest.mark.slow

PICTURES = {
    "table": ["table.png", "table_errors.png"],
    "acuity": ["acuity.png"],
    "groups": ["groups.png"],
    "ablation": ["ablation.png", "ablation_noise.png"],
    "latents": ["latents.png"],
}
RUNS = {"table": 24 * 3, "acuity": 18 * 3, "groups": 36 * 3, "ablation": 54 * 3, "latents": (2 + 3 * 3) * 4 * 3}


def make_dataset(folder, seed, count=24):
    Dataset.create_or_resume(folder, "centering", seed, {})
    for index in range(count):
        episode = make_episode(index, seed, steps=3, size=76, angle=index % 4 * np.pi / 2 + 0.1)
        write_episode(episode, folder / f"episode_{index:06d}.hdf5")
    return folder


@pytest.fixture(scope="module")
def datasets(tmp_path_factory):
    """Where from: training and samples of the separate test set, as options."""
    folder = tmp_path_factory.mktemp("data")
    return "--data", make_dataset(folder / "a", 0), "--separate-test", make_dataset(folder / "b", 1)


@pytest.fixture
def quick(monkeypatch):
    """Choose how to pretend to train."""

    def choose(train):
        monkeypatch.setattr(command, "Training", functools.partial(Training, train=train))

    choose(pretend.train)
    return choose


@pytest.fixture(scope="module")
def latents(tmp_path_factory):
    """Options that name a checkpoint of every kind of latent model, for the experiment that asks for them."""
    folder = tmp_path_factory.mktemp("latents")
    files = [write_latent(folder / f"{model}.ckpt", model) for model in MODELS]
    return {"latents": ("--latents", *files)}


def run(name, *options):
    few = ("--test-samples", 8, "--workers", 1)
    return cli.main([str(word) for word in (f"centering-{name}", *few, *options)])


def written(out):
    return {file.parent.name: file.stat().st_mtime_ns for file in out.glob("runs/*/result.json")}


def is_drawn(file):
    picture = plt.imread(file)[..., :3]
    return picture.std() > 0.05 and picture.shape[1] == 1000 and file.stat().st_size < 200_000


def test_a_real_table_from_start_to_end(datasets, tmp_path, capsys):
    few = ("--seeds", 1, "--train-samples", 8, "--epochs", 1, "--preset", "tiny")
    options = (*datasets, *few, "--out", tmp_path / "o")
    assert run("table", *options) == 0
    printed = capsys.readouterr()
    first = written(tmp_path / "o")
    assert len(first) == 6
    assert "6/6 " in printed.err
    assert (tmp_path / "o" / "table.md").read_text() in printed.out
    numbers = json.loads((tmp_path / "o" / "runs" / "f_D4_8_seed0" / "result.json").read_text())["result"]
    words = f"| F | SVFL | ours, test split | {100 * numbers['test_accuracy']:.1f} |"
    assert words in printed.out
    rows = list(csv.DictReader((tmp_path / "o" / "runs.csv").open()))
    assert {row["run"] for row in rows} == set(first)
    assert all(float(row["separate_test_accuracy"]) <= 1 for row in rows)
    assert is_drawn(tmp_path / "o" / "table.png")
    (made,), first_run = recorded(tmp_path / "o"), recorded(tmp_path / "o" / "runs" / "f_D4_8_seed0")
    assert made.data == first_run[0].data
    assert re.search(r"## Provenance\n(.*\n)*- 6 runs: commit|## Provenance\n(.*\n)*- 6 runs: no git", printed.out)
    assert made.data["data"].sha256[:12] in printed.out
    assert run("table", *options) == 0
    assert written(tmp_path / "o") == first


@pytest.mark.parametrize("name", COMMANDS)
def test_every_experiment_makes_its_page(name, datasets, latents, quick, monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(command, "_check_enough", lambda *arguments: None)
    more = latents.get(name, ())
    assert run(name, *datasets, *more, "--out", tmp_path / "out", "--copy-report-to", tmp_path / "docs") == 0
    assert len(written(tmp_path / "out")) == RUNS[name]
    text = (tmp_path / "docs" / f"{name}.md").read_text()
    assert text in capsys.readouterr().out
    assert f"- {RUNS[name]} runs, {RUNS[name]} of them finished: seeds 0 to 2." in text
    assert f"svfl-train centering-{name} --data" in text
    assert "test split: 8 of the 24 samples" in text
    assert "separate test set: all 24 samples" in text
    assert "epochs 500" in text or "500 epochs" in text
    assert "Training time of all runs together:" in text
    for picture in PICTURES[name]:
        assert f"]({picture})" in text
        assert is_drawn(tmp_path / "docs" / picture)
    rows = list(csv.DictReader((tmp_path / "docs" / f"{name}.csv").open()))
    assert len(rows) == RUNS[name] / 3
    shown = np.array(re.findall(r"([\d.]+) \+- ([\d.]+)", text), dtype=float)
    for row in rows:
        numbers = float(row["test"]), float(row["test_error"])
        assert np.abs(shown - numbers).max(axis=1).min() < 0.06
        assert row["seeds"] == "3"
    lines = [line for line in text.splitlines() if line.startswith("|")]
    assert all(line.count("|") == lines[0].count("|") for line in lines[: lines.index(lines[0]) + 5])


def test_without_separate_test_samples_there_is_one_accuracy(datasets, quick, tmp_path):
    assert run("table", *datasets[:2], "--seeds", 1, "--train-samples", 10, "--out", tmp_path / "out") == 0
    text = (tmp_path / "out" / "table.md").read_text()
    assert "ours, separate test set" not in text
    assert "+-" not in text.split("ours, test split")[1].split("\n")[0]  # of one seed there is no standard error


def test_a_changed_dataset_or_recipe_is_refused(quick, tmp_path, capsys):
    data = make_dataset(tmp_path / "data", 0)
    options = ("--data", data, "--seeds", 1, "--train-samples", 8, "--out", tmp_path / "out")
    assert run("table", *options) == 0
    first = written(tmp_path / "out")
    for changed, facts in [
        (("--epochs", 7), "epochs = 500.* 7"),
        (("--separate-test", data), f"separate_test = None.* '{data}'"),
    ]:
        capsys.readouterr()
        assert run("table", *options, *changed) == 1
        error = capsys.readouterr().err
        assert re.search(f"{facts}.* --out", error)
        assert error.count("\n") == 1
    (data / "episode_000000.hdf5").unlink()
    write_episode(make_episode(0, seed=9, steps=3, size=76), data / "episode_000000.hdf5")
    assert run("table", *options) == 1
    assert re.search(f"content of {data} .*24 episodes.* 24", capsys.readouterr().err)
    assert written(tmp_path / "out") == first


def test_failed_runs_are_told_and_tried_again(datasets, quick, tmp_path, capsys):
    quick(pretend.train_with_accidents)
    options = (*datasets, "--seeds", 2, "--train-samples", 8, "--out", tmp_path / "out")
    assert run("table", *options) == 1
    printed = capsys.readouterr()
    last = printed.err.splitlines()[-1]
    assert re.match("svfl-train: 6 of 12 .*vf_D4_8_seed1: the train loss became nan; .* 3 more", last)
    assert "(1 of 2 seeds)" in printed.out
    quick(pretend.train)
    assert run("table", *options) == 0
    assert "(1 of 2 seeds)" not in capsys.readouterr().out


@pytest.mark.parametrize("name", COMMANDS)
def test_a_page_of_failures_is_a_page_of_dashes(name, datasets, latents, quick, tmp_path, capsys):
    quick(pretend.train_in_vain)
    assert (
        run(name, *datasets, *latents.get(name, ()), "--seeds", 1, "--train-samples", 8, "--out", tmp_path / "out") == 1
    )
    text = (tmp_path / "out" / f"{name}.md").read_text()
    assert "0 of them finished" in text
    assert "| - |" in text
    assert not re.search(r"\bnan\b", text)
    assert re.search(r"(\d+) of \1 runs failed", capsys.readouterr().err)


def test_runs_of_another_experiment_are_taken_over(datasets, latents, quick, tmp_path, capsys):
    few = (*datasets, "--seeds", 1, "--train-samples", 8)
    assert run("table", *few, "--out", tmp_path / "table") == 0
    quick(pretend.train_in_vain)
    more = (*latents["latents"], "--reuse", tmp_path / "table")
    assert run("latents", *few, *more, "--out", tmp_path / "out") == 1
    assert set(written(tmp_path / "out")) == {"vf_D4_8_seed0", "vf_none_8_seed0"}
    capsys.readouterr()
    assert run("latents", *few, "--epochs", 7, *more, "--out", tmp_path / "others") == 1
    assert written(tmp_path / "others") == {}
    assert run("latents", *datasets[:2], *few[4:], *more, "--out", tmp_path / "unlike") == 1
    assert "another --separate-test" in capsys.readouterr().err
    assert run("latents", *few, *latents["latents"], "--reuse", tmp_path, "--out", tmp_path / "none") == 1
    assert f"{tmp_path} holds no experiment" in capsys.readouterr().err


def test_ctrl_c_keeps_finished_runs(datasets, quick, monkeypatch, tmp_path, capsys):
    options = (*datasets, "--seeds", 1, "--train-samples", 8, "--out", tmp_path / "out")
    with monkeypatch.context() as pressing:
        pressing.setattr(Bar, "ended", lambda *arguments: signal.raise_signal(signal.SIGINT))
        assert run("table", *options) == 130
    first = written(tmp_path / "out")
    assert set(first) == {"vf_D4_8_seed0"}
    assert capsys.readouterr().err == "svfl-train: interrupted; everything finished so far is on disk\n"
    assert run("table", *options) == 0
    assert first.items() <= written(tmp_path / "out").items()


@pytest.mark.parametrize("kind", ["nothing", "empty", "unlabelled"])
def test_wrong_separate_test_samples_are_told_before_a_folder_is_claimed(kind, datasets, quick, tmp_path, capsys):
    wrong = tmp_path / "wrong"
    if kind != "nothing":
        Dataset.create_or_resume(wrong, "picking", 0, {})
    if kind == "unlabelled":
        episode = make_episode(0, steps=3, size=76)
        labels = [name for name in episode.arrays if name.startswith("labels/")]
        arrays = {name: values for name, values in episode.arrays.items() if name not in labels}
        write_episode(replace(episode, arrays=arrays), wrong / Dataset.file_name(0))
    few = (*datasets[:2], "--seeds", 1, "--train-samples", 8, "--out", tmp_path / "out")
    assert run("table", *few, "--separate-test", wrong) == 1
    said = capsys.readouterr().err
    assert str(wrong) in said
    assert said.count("\n") == 1
    assert not (tmp_path / "out").exists()
    assert run("table", *few, *datasets[2:]) == 0


def test_a_folder_in_which_nothing_came_of_it_can_be_taken_again(datasets, quick, tmp_path, capsys):
    quick(pretend.train_in_vain)
    few = (*datasets, "--seeds", 1, "--train-samples", 8, "--out", tmp_path / "out")
    assert run("table", *few, "--learning-rate", 9) == 1
    quick(pretend.train)
    assert run("table", *few) == 0
    capsys.readouterr()
    assert run("table", *few, "--learning-rate", 9) == 1
    assert re.search(r"learning_rate = 0\.001.* 9\.0", capsys.readouterr().err)


def test_too_few_samples_are_told_before_anything_begins(datasets, tmp_path, capsys):
    assert run("table", *datasets, "--out", tmp_path / "out") == 1
    assert re.search("24 samples.* 8 .*testing.* 100 .*training.* 108", capsys.readouterr().err)
    assert not (tmp_path / "out").exists()


@given(st.lists(st.floats(0, 100), min_size=2, max_size=9))
def test_mean_and_standard_error(values):
    mean = Mean.of(values)
    assert mean.mean == pytest.approx(np.mean(values), abs=1e-9)
    assert mean.error == pytest.approx(np.std(values, ddof=1) / np.sqrt(len(values)), abs=1e-6)


def test_means_of_little():
    assert Mean.of([]) is None
    assert str(Mean.of([97.0])) == "97.0"
    assert str(Mean.of([96.0, 97.0, 98.0])) == "97.0 +- 0.6"


def cell_of(*accuracies, **changes):
    config = replace(TrainingConfig("data"), **changes)
    runs = [Run("r", config, None, None if a is None else {"test_accuracy": a}) for a in accuracies]
    return Cell(config, tuple(runs))


def test_a_cell_without_runs_is_a_dash():
    assert page.accuracy_words(cell_of(None, None), "test split") == "-"
    assert page.accuracy_words(cell_of(0.5, None), "test split") == "50.0 (1 of 2 seeds)"


@pytest.mark.parametrize(("accuracy", "good"), [(0.993, True), (0.9926, True), (0.9924, False), (None, None)])
def test_the_papers_figure_is_reached_or_not(accuracy, good):
    cell = cell_of(accuracy)
    assert table.reaches(cell, cell.test) is good
    unpublished = cell_of(1.0, train_samples=11)
    assert table.reaches(unpublished, unpublished.test) is None


def test_accuracy_by_distance_counts_every_prediction_once():
    rng = np.random.default_rng(0)
    border = np.concatenate([rng.uniform(0, 45, 998), [0.0, 45.0]])
    right = rng.random(1000) < 0.7
    one = Predictions("separate_test", np.zeros(1000, int), np.where(right, 0, 2), border, border)
    bins = one.accuracy_by(border, np.arange(0, 50, 5))
    assert sum(count for _, _, count, _ in bins) == 1000
    assert sum(count * share for _, _, count, share in bins) / 1000 == pytest.approx(100 * right.mean())
    assert one.confusion[0].tolist() == [right.sum(), 0, (~right).sum(), 0]


@pytest.mark.parametrize("sigma", [2.0, 8.0, 25.0])
def test_errors_tell_how_well_the_direction_was_read(sigma):
    rng = np.random.default_rng(0)
    border = rng.uniform(0, 45, 20000)
    crossed = rng.normal(0, sigma, len(border)) > border
    one = Predictions("separate_test", np.zeros(len(border), int), crossed.astype(int), border, border)
    assert one.reading_error_deg == pytest.approx(sigma, rel=0.1)


def test_cells_gather_their_seeds(tmp_path):
    configs = {f"r{seed}": TrainingConfig("data", seed=seed) for seed in range(3)}
    for name, config in configs.items():
        pretend.train(config, tmp_path / name, None)
    (cell,) = Results(configs, tmp_path).cells
    expected = [
        json.loads((tmp_path / name / "result.json").read_text())["result"]["test_accuracy"] for name in configs
    ]
    assert cell.test.mean == pytest.approx(100 * np.mean(expected))
    assert cell.separate is None
