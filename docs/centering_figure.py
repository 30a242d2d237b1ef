"""Draw docs/centering/table.png again from docs/centering/table.csv, without training.

.venv/bin/python docs/centering_figure.py
"""

import csv
from pathlib import Path

from svfl_models.experiments.page import MODELS
from svfl_models.experiments.results import SEPARATE_TEST_SET, Mean
from svfl_models.experiments.table import Lines, accuracy_figure
from svfl_models.training.figures import save

FOLDER = Path(__file__).resolve().parent / "centering"


def stored_accuracies() -> Lines:
    """Return the accuracies on the separate test set by input, network and number of training samples."""
    names = {group: model for model, group in MODELS.items()}
    lines: Lines = {}
    with (FOLDER / "table.csv").open(newline="") as file:
        for row in csv.DictReader(file):
            mean = Mean(float(row["separate_test"]), float(row["separate_test_error"]), int(row["seeds"]))
            line = lines.setdefault((row["encoder"], names[row["group"]]), {})
            line[int(row["train_samples"])] = mean
    return lines


def main() -> None:
    """Write the figure."""
    save(accuracy_figure(stored_accuracies(), f"accuracy on the {SEPARATE_TEST_SET}, %"), FOLDER / "table.png")


if __name__ == "__main__":
    main()
