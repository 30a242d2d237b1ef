"""Trainings that take no time and leave what real ones leave, for tests of experiments."""

import csv
import json
import os
import sys
import time
from pathlib import Path

import numpy as np

from svfl_data.errors import DatasetError, TrainingError
from svfl_data.symmetry import border_distance, nearest_direction
from svfl_data.system.atomic_io import write_atomically
from svfl_models.centering.config import TrainingConfig
from svfl_models.training import run_folder

SAMPLES = {"test": 100, "separate_test": 400}
COLUMNS = ("samples", "episode", "direction", "predicted", "border_deg", "offset_x", "offset_y", "guess_x", "guess_y")


def train(config, out, separate_test):
    """A network that errs near the border, the less the more samples it has."""
    out.mkdir(parents=True)
    rng = np.random.default_rng([config.seed, config.train_samples])
    blur = (0.3 if config.model == "svfl" else 0.5) * (0.5 if "f" in config.encoder else 1) + 2 / config.train_samples
    blur += 2 / config.image_size + 0.02 * config.noise
    names = ("test", "separate_test") if separate_test else ("test",)
    accuracy, rows = {}, []
    for name in names:
        angle, length = rng.uniform(-np.pi, np.pi, SAMPLES[name]), rng.uniform(0.015, 0.055, SAMPLES[name])
        offset = length[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        truth = nearest_direction(offset)
        angle = angle + rng.normal(0, blur, len(angle))
        predicted = nearest_direction(np.stack([np.cos(angle), np.sin(angle)], axis=-1))
        border = np.rad2deg(border_distance(offset))
        accuracy[name] = float((truth == predicted).mean())
        rows += [(name, i, truth[i], predicted[i], f"{border[i]:.2f}", *offset[i], "", "") for i in range(len(truth))]
    with (out / run_folder.PREDICTIONS).open("w", newline="") as file:
        csv.writer(file).writerows([COLUMNS, *rows])
    result = {
        "test_accuracy": accuracy["test"], "best_test_accuracy": accuracy["test"],
        "separate_test_accuracy": accuracy.get("separate_test"), "epochs": config.epochs, "parameters": 1234,
        "seconds": config.train_samples * (5.0 if "v" in config.encoder else 1.0) * (1 + 0.1 * config.seed),
    }  # fmt: skip
    (out / run_folder.RESULT).write_text(json.dumps({"config": config.plain(), "result": result}))


def train_with_accidents(config, out, separate_test):
    """Seed 1 diverges, seed 2 kills its process, seed 3 meets our own mistake."""
    if config.seed == 1:
        raise TrainingError("the train loss became nan")
    if config.seed == 2:
        os._exit(9)
    if config.seed == 3:
        raise ZeroDivisionError("two lines\nof message")
    train(config, out, separate_test)


def train_in_vain(config, out, separate_test):
    """Every run diverges."""
    raise TrainingError("the train loss became nan")


def train_without_data(config, out, separate_test):
    """What befalls one run would befall all."""
    raise DatasetError("the dataset has no labels")


def train_seed_0_only(config: TrainingConfig, out, separate_test):
    """The other seeds take longer than any test waits."""
    if config.seed:
        out.mkdir(parents=True)
        (out / "checkpoint.ckpt").write_text("half a training")
        time.sleep(600)
    train(config, out, separate_test)


def train_for_ever(config, out, separate_test):
    """Says who does it, and takes longer than any test waits."""
    out.mkdir(parents=True)
    write_atomically(out / "process", str(os.getpid()).encode())
    time.sleep(600)


def train_and_tell(config, out, separate_test):
    """Leaves a note about what the process sees, and lasts long enough for every worker to get one."""
    train(config, out, separate_test)
    (out / "device").write_text(f"{os.environ['CUDA_VISIBLE_DEVICES']} torch: {'torch' in sys.modules}")
    time.sleep(1)


def is_running(process):
    """Whether there is such a process; dead ones that nobody has buried yet have no command line."""
    try:
        return bool(Path(f"/proc/{process}/cmdline").read_bytes())
    except (FileNotFoundError, ProcessLookupError):
        return False
