"""Reuse of the runs of another experiment, because the same configuration on the same data gives the same numbers."""

import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from svfl_data.errors import FormatError, TrainingError
from svfl_data.system.side_files import read_json
from svfl_models.centering.config import TrainingConfig
from svfl_models.experiments.runs.folder import ABOUT, RUNS, finished


def take_from(other: Path, about: dict[str, Any], out: Path, runs: Mapping[str, TrainingConfig]) -> list[str]:
    """Copy those runs of this experiment that another experiment has finished.

    Args:
        other: Folder of the other experiment.
        about: Description of this experiment, as `folder.describe` returns it.
        out: Folder of this experiment, locked by this process.
        runs: Configurations of this experiment's runs by name. Runs that have finished here are not replaced.

    Returns:
        Names of the runs that were copied.

    Raises:
        TrainingError: If `other` is not the folder of an experiment, or that experiment is on other data.
    """
    try:
        found = read_json(other / ABOUT)
        differ = [option for option in ("data", "separate_test") if found[option] != about[option]]
    except (OSError, FormatError, KeyError, TypeError) as error:
        raise TrainingError(f"{other} holds no experiment to take runs from ({error!r})") from error
    if differ:
        option = differ[0].replace("_", "-")
        raise TrainingError(f"{other} holds runs with another --{option} than this experiment; none can be taken over")
    done = {_key(one["config"]): run for run in sorted((other / RUNS).iterdir()) if (one := finished(run))}
    copied = []
    for name, config in runs.items():
        source, target = done.get(_key(config.plain())), out / RUNS / name
        if source and not finished(target):
            shutil.rmtree(target, ignore_errors=True)  # left by a run that was stopped or failed
            half = target.with_name(f"{name}.copy")
            shutil.rmtree(half, ignore_errors=True)
            shutil.copytree(source, half)
            half.rename(target)
            copied.append(name)
    return copied


def _key(config: dict[str, Any]) -> str:
    return json.dumps(config, sort_keys=True)
