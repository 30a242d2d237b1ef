"""Pages say of their numbers only what these numbers show."""

from dataclasses import replace

import numpy as np
import pytest

from svfl_data.reports.success_rate import wilson
from svfl_models.centering.config import Latent, TrainingConfig
from svfl_models.centering.report import Result as CenteringResult
from svfl_models.centering.report import page as report
from svfl_models.experiments import error_analysis, latents, page, table
from svfl_models.experiments.results import Results
from tests.helpers import pretend
from tests.helpers.experiment_pages import ABOUT, DOWN, UP, network


def section(tmp_path, direction, predicted, border_deg=40.0):
    return error_analysis.section([network(tmp_path / "v", "v", direction, predicted, border_deg)], "picture.png")


def test_a_network_at_chance_gets_no_explanation_of_its_errors(tmp_path):
    """At 24 % every error may be anything, and no accuracy of the angle can be read off them."""
    direction = np.arange(400) % 4
    predicted = np.where(np.arange(400) < 96, direction, (direction + 2) % 4)
    said = section(tmp_path, direction, predicted)
    assert "At chance (25% of the directions, within the 95 % interval): V." in said
    assert "gripper" not in said
    assert "normal error" not in said


def test_hidden_blocks_are_named_where_up_is_taken_for_down(tmp_path):
    direction = np.arange(400) % 4
    swapped = (direction == UP) & (np.arange(400) < 80)
    said = section(tmp_path, direction, np.where(swapped, DOWN, direction))
    assert "20 degrees or more from a border that take up for down or down for up: 20 of 20, more" in said
    assert "a gripper between camera and block" in said
    assert "At chance" not in said


def test_other_errors_are_not_put_down_to_hidden_blocks(tmp_path):
    direction = np.arange(400) % 4
    predicted = np.where(np.arange(400) < 90, (direction + np.arange(400) // 4 % 3 + 1) % 4, direction)
    said = section(tmp_path, direction, predicted)
    assert "not significantly more than the 17% of arbitrary errors" in said
    assert "a gripper between" not in said


def test_errors_near_a_border_say_nothing_of_hidden_blocks(tmp_path):
    direction = np.arange(400) % 4
    said = section(tmp_path, direction, np.where(direction == UP, DOWN, direction), border_deg=5.0)
    assert "Errors of V" not in said


def results_of(tmp_path, seeds=3, **changes):
    base = replace(TrainingConfig("data", encoder="f"), **changes)
    configs = {
        f"{group}{seed}": replace(base, group=group, seed=seed) for group in ("D4", "none") for seed in range(seeds)
    }
    for name, config in configs.items():
        pretend.train(config, tmp_path / name, None)
    return Results(configs, tmp_path)


@pytest.mark.parametrize(("seeds", "told"), [(1, "seed 0."), (3, "seeds 0 to 2.")])
def test_seeds_are_counted(tmp_path, seeds, told):
    said = page.how("svfl-train", results_of(tmp_path, seeds), ABOUT, seeds)
    assert f"of them finished: {told}" in said
    assert ("standard error" in said) == (seeds > 1)


def test_every_seed_and_its_interval_are_on_the_page(tmp_path):
    results = results_of(tmp_path)
    said = page.seeds(results)
    for cell in results.cells:
        each = [f"{100 * run.result['test_accuracy']:.1f}" for run in cell.runs]
        assert f"| {', '.join(each)} |" in said
    assert "seeds and samples are resampled" in said
    assert "one seed" not in said


def test_of_one_seed_the_page_gives_the_interval_of_its_samples_and_says_so(tmp_path):
    results = results_of(tmp_path, seeds=1)
    said = page.seeds(results)
    accuracy = results.runs[0].result["test_accuracy"]
    low, high = wilson(round(100 * accuracy), 100)
    assert f"| {100 * accuracy:.1f} | {100 * low:.0f} to {100 * high:.0f} | {100 * accuracy:.1f} |" in said
    assert "the spread between seeds is unknown" in said
    assert "resampled" not in said


def test_without_a_finished_run_there_are_no_seeds(tmp_path):
    assert page.seeds(Results({"run": TrainingConfig("data")}, tmp_path)) == ""


def test_numbers_of_parameters_are_those_of_the_runs(tmp_path):
    base = TrainingConfig("data", train_samples=10)
    configs = {f"{n}": config for n, config in enumerate(table.cells(base, [10]))}
    assert "parameters of" not in table.body(Results(configs, tmp_path))
    for name, config in configs.items():
        pretend.train(config, tmp_path / name, None)
    assert "V 1,234 and 1,234; F 1,234" in table.body(Results(configs, tmp_path))


@pytest.mark.parametrize(("data", "other"), [("data", False), ("data/picking", True)])
def test_the_pretraining_is_described_as_it_was(tmp_path, data, other):
    latent = Latent("file", "0" * 64, "poe", data, "tiny", 10)
    base = TrainingConfig("data", encoder="vf", train_samples=10)
    configs = {f"{n}": config for n, config in enumerate(latents.cells(base, [10], [latent]))}
    for name, config in configs.items():
        pretend.train(config, tmp_path / name, None)
    said = latents.body(Results(configs, tmp_path))
    assert ("the pretraining used others: data/picking." in said) == other
    assert "newtons" not in said
    assert "took as long as this many epochs of its head: PoE 3." in said  # 150 epochs in the time of 500


def result(**changes):
    usual = {
        "test_accuracy": 0.5, "best_test_accuracy": 0.5, "separate_test_accuracy": None, "offset_error_mm": None,
        "epochs": 500, "seconds": 1.0, "parameters": 1, "train_samples": [1] * 4, "confusion": [[1] * 4] * 4,
    }  # fmt: skip
    return CenteringResult(**usual | changes)


@pytest.mark.parametrize(
    ("patience", "epochs", "told"),
    [(0, 500, "lasted 500 epochs"), (50, 500, "lasted all 500 epochs"), (50, 120, "stopped after 120 of at most 500")],
)
def test_a_report_says_how_the_training_ended(patience, epochs, told):
    assert told in report(TrainingConfig("data", patience=patience), result(epochs=epochs))


@pytest.mark.parametrize(("samples", "published"), [(100, True), (101, False)])
def test_a_report_compares_with_the_paper_where_it_has_such_a_cell(samples, published):
    said = report(TrainingConfig("data", train_samples=samples), result())
    assert ("paper, same cell" in said) == ("not published" in " ".join(said.split())) == published
