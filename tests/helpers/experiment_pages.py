"""What the pages of experiments are made from: finished runs with given predictions or successes."""

import csv
import json

from svfl_models.centering.config import TrainingConfig
from svfl_models.experiments.results import Cell, Run
from svfl_models.training import run_folder
from tests.helpers.pretend import COLUMNS
from tests.helpers.pretend_cloning import Quick

UP, DOWN = 1, 3
ABOUT = {
    "recipe": TrainingConfig("data").plain(), "data": {"path": "data", "episodes": 200}, "separate_test": None,
}  # fmt: skip


def network(folder, encoder, direction, predicted, border_deg):
    """A cell of one finished run with these predictions."""
    folder.mkdir(parents=True)
    rows = [
        ("test", 0, true, said, border_deg, 0.03, 0, "", "") for true, said in zip(direction, predicted, strict=True)
    ]
    with (folder / run_folder.PREDICTIONS).open("w", newline="") as file:
        csv.writer(file).writerows([COLUMNS, *rows])
    config = TrainingConfig("data", encoder=encoder)
    return Cell(config, (Run("run", config, folder, {"test_accuracy": 0.5}),))


def pretend(run):
    """What a finished run leaves."""
    Quick(run.config, run.folder, run.test_episodes)()


def tell(run, *success):
    """What a finished run leaves that succeeded in these trials."""
    pretend(run)
    (run.folder / run_folder.EVALUATION).write_text(json.dumps({"success": success}))
