"""A sentence stands on a page of an experiment where its numbers say so, and nowhere else."""

import numpy as np
import pytest

from svfl_models.centering.config import Latent, TrainingConfig
from svfl_models.cloning.config import CloningConfig
from svfl_models.experiments import cloning_table, cloning_table_page, error_analysis, latents, page, table
from svfl_models.experiments.cloning_table import Table
from svfl_models.experiments.results import Results
from tests.helpers import pretend
from tests.helpers.experiment_pages import ABOUT, DOWN, UP, network, tell

TRIALS = 4
BASE = CloningConfig("", preset="tiny", epochs=2)
FOUR = np.arange(400) % 4


def said_of(tmp_path, direction, predicted, border_deg=40.0):
    """The sentences below the table of the section on errors."""
    cells = [network(tmp_path / "v", "v", direction, predicted, border_deg)]
    section = error_analysis.section(cells, "picture.png")
    return section.rpartition("|\n")[2].partition("![")[0].strip()


def wrong(count, by=1):
    """Predictions, so many of which are wrong: the next direction, the opposite one, ..."""
    return np.where(np.arange(len(FOUR)) < count, (FOUR + by) % 4, FOUR)


@pytest.mark.parametrize(
    ("right", "place"), [(0, "Below"), (60, "Below"), (84, "At"), (100, "At"), (115, "At"), (200, ""), (400, "")]
)
def test_a_network_is_above_at_or_below_chance(right, place, tmp_path):
    said = said_of(tmp_path, FOUR, wrong(400 - right))
    for word in ("At", "Below"):
        assert (f"{word} chance (25% of the directions" in said) == (word == place)
    assert ("within the 95 % interval): V." in said) == (place == "At")
    assert ("outside the 95 % interval): V." in said) == (place == "Below")


@pytest.mark.parametrize(("errors", "told"), [(0, True), (40, True), (180, True), (220, False), (400, False)])
def test_an_error_of_the_angle_is_read_off_where_it_can_explain_the_errors(errors, told, tmp_path):
    """Near a border at most half of the samples cross it, whatever the error."""
    said = said_of(tmp_path, FOUR, wrong(errors), border_deg=10.0)
    assert ("a normally distributed error" in said) == told
    assert "180.0 (V)" not in said


MORE, NOT_MORE = ", more than the 17%", "not significantly more than"


@pytest.mark.parametrize(
    ("swaps", "others", "words"),
    [
        (0, 30, None), (1, 0, NOT_MORE), (2, 0, NOT_MORE), (3, 0, MORE), (20, 20, MORE), (5, 25, NOT_MORE),
        (1, 40, NOT_MORE),
    ],
)  # fmt: skip
def test_up_for_down_is_told_from_arbitrary_errors_by_its_number(swaps, others, words, tmp_path):
    up, left = np.flatnonzero(FOUR == UP)[:swaps], np.flatnonzero(FOUR == 0)[:others]
    predicted = FOUR.copy()
    predicted[up], predicted[left] = DOWN, UP
    said = said_of(tmp_path, FOUR, predicted)
    assert ("that take up for down" in said) == (words is not None)
    assert (f"{swaps} of {swaps + others}" in said) == (words is not None)
    for one in (NOT_MORE, MORE):
        assert (one in said) == (one == words)
    assert ("a gripper between camera and block" in said) == (words == ", more than the 17%")


def test_errors_are_told_of_nothing_where_nothing_was_predicted(tmp_path):
    assert said_of(tmp_path, [], []) == ""


def finished(tmp_path, configs, count):
    """Results of as many finished runs."""
    for name, config in list(configs.items())[:count]:
        pretend.train(config, tmp_path / name, None)
    return Results(configs, tmp_path)


@pytest.mark.parametrize(
    ("done", "words"),
    [(0, None), (1, "of one seed, so without"), (2, "mean +- standard error"), (3, "mean +- standard error")],
)
def test_accuracies_have_the_spread_of_the_seeds_that_are_finished(done, words, tmp_path):
    configs = {f"{seed}": TrainingConfig("data", encoder="f", seed=seed) for seed in range(3)}
    said = page.how("svfl-train", finished(tmp_path, configs, done), ABOUT, 3)
    for one in ("of one seed, so without", "mean +- standard error"):
        assert (one in said) == (one == words)


@pytest.mark.parametrize(("patience", "told"), [(0, False), (5, True)])
def test_the_page_says_what_the_training_takes_from_the_test_samples(patience, told, tmp_path):
    about = ABOUT | {"recipe": TrainingConfig("data", patience=patience).plain()}
    results = finished(tmp_path, {"run": TrainingConfig("data", encoder="f", patience=patience)}, 1)
    assert ("only the end of a training depends on them" in page.how("svfl-train", results, about, 1)) == told


@pytest.mark.parametrize(
    ("count", "runs", "words"),
    [(10, 0, "is finished yet"), (11, 6, "has no such cells"), (11, 0, "has no such cells"), (10, 6, "Bold: SVFL")],
)
def test_the_paper_is_compared_with_what_is_finished(count, runs, words, tmp_path):
    configs = {f"{n}": one for n, one in enumerate(table.cells(TrainingConfig("data"), [count]))}
    said = table.body(finished(tmp_path, configs, runs))
    for one in ("is finished yet", "has no such cells", "Bold: SVFL"):
        assert (one in said) == (one == words)


def test_the_page_counts_the_cells_that_reach_the_paper(tmp_path):
    configs = {f"{n}": one for n, one in enumerate(table.cells(TrainingConfig("data"), [10]))}
    results = finished(tmp_path, configs, 6)
    good = {}
    for run in results.runs:
        if run.config.model == "svfl":
            good[run.config.encoder] = run.config.encoder != "f"
            run.result["test_accuracy"] = 0.9 if good[run.config.encoder] else 0.2
    said = table.body(results)
    assert "On the test split 2 of 3 SVFL cells are at or above the paper's (below: F 10)." in said
    for run in results.runs:
        run.result["test_accuracy"] = 0.9
    assert "3 of 3 SVFL cells are at or above the paper's." in table.body(results)


@pytest.mark.parametrize("uses", [("frozen",), ("fine-tuned", "from-scratch"), ("from-scratch",)])
def test_only_the_uses_of_an_encoder_that_occur_are_explained(uses, tmp_path):
    latent = Latent("file", "0" * 64, "poe", "data", "tiny", 10)
    base = TrainingConfig("data", train_samples=10)
    configs = {f"{n}": one for n, one in enumerate(latents.cells(base, [10], [latent], uses))}
    said = latents.body(finished(tmp_path, configs, len(configs)))
    for use, words in (("frozen", "- frozen:"), ("fine-tuned", "- fine-tuned:"), ("from-scratch", "- from scratch:")):
        assert (words in said) == (use in uses)
    assert ("An epoch that trains the whole encoder took" in said) == ({"frozen", "fine-tuned"} <= {*uses})


def cloned(tmp_path, tasks, episodes, seeds, networks, done):
    """The page of a table, as many of whose runs have succeeded as often as a function says."""
    data = [f"data/{task}" for task in tasks]
    runs = cloning_table.runs(BASE, data, episodes, seeds, TRIALS, tmp_path / "runs", networks)
    for run in runs:
        count = done(run)
        if count is not None:
            tell(run, *[index < count for index in range(TRIALS)])
    out = tmp_path / "page"
    out.mkdir()
    words, _ = cloning_table_page.write(Table(runs), "svfl-train bc-table", out)
    return words


@pytest.mark.parametrize(("done", "told"), [(lambda run: None, False), (lambda run: 0, True), (lambda run: 2, True)])
def test_intervals_are_explained_where_there_are_some(done, told, tmp_path):
    said = cloned(tmp_path, ["picking"], [5], 2, ["svfl"], done)
    assert ("No policy has been evaluated yet" in said) != told
    assert ("seeds and scenes are resampled" in said) == told
    assert "Each policy was tried" not in said
    assert "one seed" not in said


def test_of_some_rows_the_spread_may_be_unknown(tmp_path):
    first = [tmp_path / "first", tmp_path / "both"]
    for folder in first:
        folder.mkdir()
    said = cloned(first[0], ["picking"], [5, 10], 2, ["svfl"], lambda run: 2 if run.config.seed == 0 else None)
    assert "Of one seed the spread between seeds is unknown" in said
    assert "resampled" not in said
    assert "Errors with 10 demonstrations, of one seed:" in said
    said = cloned(
        first[1], ["picking"], [5, 10], 2, ["svfl"],
        lambda run: None if run.config.episodes == 5 and run.config.seed else 2,
    )  # fmt: skip
    assert "Of rows with one seed the spread between seeds is unknown" in said
    assert "resampled" in said
    assert "Errors with 10 demonstrations, mean over the seeds:" in said


@pytest.mark.parametrize(
    ("seeds", "fewer", "more", "words"),
    [
        (3, [4, 4, 4], [0, 0, 0], "picking CNN 10 minus 5"),
        (3, [4, 0, 3], [1, 2, 2], "none."),
        (1, [4], [0], "unknown for a single seed."),
        (3, [0, 0, 0], [4, 4, 4], None),
        (3, [0, 0, 0], [0, 0, 0], None),
    ],
)
def test_a_fall_is_told_with_what_is_known_of_it(seeds, fewer, more, words, tmp_path):
    said = cloned(
        tmp_path, ["picking"], [5, 10], seeds, ["cnn"],
        lambda run: (fewer if run.config.episodes == 5 else more)[run.config.seed],
    )  # fmt: skip
    assert ("The success rate is lower with more demonstrations" in said) == (words is not None)
    if words:
        assert f"in 1 of 1 case; significant: {words}" in said


@pytest.mark.parametrize(
    ("done", "verdict"),
    [
        (lambda run: 4 if run.config.model == "svfl" else 0, "yes"),
        (lambda run: 2, "no"),
        (lambda run: (4, 0, 2)[run.config.seed] if run.config.model == "svfl" else 2, "no"),
        (lambda run: 4 if run.config.seed == 0 else None, "unknown (one seed)"),
    ],
)
def test_a_difference_is_told_from_noise_or_not(done, verdict, tmp_path):
    said = cloned(tmp_path, ["picking"], [5], 3, ["svfl", "cnn"], done)
    assert f"| {verdict} |" in said.partition("## Differences")[2]


@pytest.mark.parametrize(("tasks", "seeds", "told"), [(1, 2, False), (2, 2, True), (2, 1, True)])
def test_all_tasks_are_summarised_if_there_are_several(tasks, seeds, told, tmp_path):
    said = cloned(tmp_path, ["picking", "pushing"][:tasks], [5], seeds, ["svfl"], lambda run: 2)
    assert ("## All tasks" in said) == told
    assert ("Where a task has one seed, the interval leaves out" in said) == (told and seeds == 1)
    assert ("seeds 0 to 1;" in said) == (seeds == 2)


@pytest.mark.parametrize(("episodes", "networks"), [([5], ["svfl"]), ([5, 10], ["svfl", "cnn"])])
def test_the_recipe_says_what_it_is_of(episodes, networks, tmp_path):
    said = cloned(tmp_path, ["picking"], episodes, 1, networks, lambda run: 2)
    assert ("Same recipe for all networks" in said) == (len(networks) > 1)
    assert ("with fewer there are more, for equally many steps" in said) == (len(episodes) > 1)
