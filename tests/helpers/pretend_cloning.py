"""Policies that take no time and leave what real ones leave, for tests of tables."""

import json
import os
import time

from svfl_data.errors import TrainingError
from svfl_data.system.atomic_io import write_atomically
from svfl_models.experiments.cloning_table import Run
from svfl_models.training import run_folder

SUCCESS = {"svfl": [True, True, True, False], "cnn": [True, False, False, False]}
RESULT = {
    "valid_gripper": 0.01, "valid_xy_mm": 4.0, "valid_z_mm": 3.0, "seconds": 10.0, "parameters": 5, "epochs": 2,
}  # fmt: skip


class Quick(Run):
    """Done at once."""

    def __call__(self) -> None:
        """Leave what a finished run leaves."""
        self.folder.mkdir(parents=True, exist_ok=True)
        done = {"config": self.config.plain(), "result": RESULT}
        (self.folder / run_folder.METRICS).write_text("epoch,train_loss,valid_loss\n0,1.0,1.1\n1,0.5,0.7\n")
        (self.folder / run_folder.RESULT).write_text(json.dumps(done))
        (self.folder / run_folder.EVALUATION).write_text(json.dumps({"success": SUCCESS[self.config.model]}))


class Diverging(Quick):
    """Done at once, but for the parameter-matched CNN baseline of seed 0."""

    def __call__(self) -> None:
        """Fail, or leave what a finished run leaves."""
        if (self.config.model, self.config.seed) == ("cnn", 0):
            raise TrainingError("the training diverged")
        super().__call__()


class Endless(Run):
    """Takes longer than any test waits."""

    def __call__(self) -> None:
        """Leave who does it where a training leaves its checkpoint."""
        self.folder.mkdir(parents=True)
        write_atomically(self.folder / run_folder.CHECKPOINT, str(os.getpid()).encode())
        time.sleep(600)
