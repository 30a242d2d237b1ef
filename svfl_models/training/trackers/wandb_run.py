"""Weights & Biases: a run in the folder ``wandb`` of a training, offline unless ``WANDB_MODE`` says otherwise."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

# What the user has set stays. Error reports, which would use the network, are switched off when it is imported.
if os.environ.setdefault("WANDB_MODE", "offline") == "offline":
    os.environ.setdefault("WANDB_ERROR_REPORTING", "false")

import wandb

FOLDER = "wandb"
PROJECT = "svfl"
LATEST = "latest-run"
"""Link that wandb sets to the folder of the last run, whose name ends with the run's id."""
STEP = "step"


class WandbRun:
    """One run of the project ``svfl`` (or that of ``WANDB_PROJECT``).

    An offline run is uploaded by ``wandb sync`` with its folder.

    Args:
        out: Folder of the training; its name is the name of the run.
        go_on: Whether to continue the last run of `out`, if there is one. Offline, that is a further folder with the
            same run id, which ``wandb sync`` appends.
    """

    def __init__(self, out: Path, go_on: bool) -> None:
        latest = out / FOLDER / LATEST
        earlier = os.readlink(latest).rpartition("-")[2] if go_on and latest.is_symlink() else None
        self._run = wandb.init(
            project=os.environ.get("WANDB_PROJECT", PROJECT),
            name=out.resolve().name,
            dir=str(out),
            id=earlier,
            resume="allow" if earlier else None,
            reinit="create_new",
            settings=wandb.Settings(silent=True, console="off"),
        )
        self._run.define_metric(STEP, hidden=True)
        self._run.define_metric("*", step_metric=STEP)

    def configuration(self, values: Mapping[str, Any]) -> None:
        """Log the configuration."""
        self._run.config.update(dict(values), allow_val_change=True)

    def numbers(self, values: Mapping[str, float], step: int) -> None:
        """Log numbers, with the number of steps beside them."""
        self._run.log({**values, STEP: step})

    def picture(self, name: str, file: Path) -> None:
        """Log a picture, or an animated GIF as a video."""
        is_video = file.suffix == ".gif"
        shown = wandb.Video(str(file), format="gif") if is_video else wandb.Image(str(file))
        self._run.log({name: shown})

    def close(self, succeeded: bool) -> None:
        """End the run."""
        self._run.finish(exit_code=0 if succeeded else 1)
