"""The output folder of a training run: claimed for one configuration, never silently shared by two."""

import json
from pathlib import Path
from typing import Any

from svfl_data.errors import StorageError, TrainingError

CONFIG = "config.json"
CHECKPOINT = "checkpoint.ckpt"
METRICS = "metrics.csv"
PREDICTIONS = "predictions.csv"
LEARNING_CURVE = "learning_curve.png"
CONFUSION = "confusion_matrix.png"
REPORT = "report.md"
RESULT = "result.json"
EVALUATION = "evaluation.json"
OWN = (CHECKPOINT, METRICS, PREDICTIONS, LEARNING_CURVE, CONFUSION, REPORT, RESULT, EVALUATION)


def claim(out: Path, config: dict[str, Any]) -> None:
    """Make a folder the home of a run and write the run's configuration into it.

    A folder that an earlier run with the same configuration used is cleared of that run's files.

    Args:
        out: The folder; it need not exist.
        config: Configuration of the run, plain values.

    Raises:
        TrainingError: If the folder belongs to a run with another configuration, to a dataset, or holds files that
            the run would overwrite.
        StorageError: If the folder cannot be written.
    """
    found = _read_config(out)
    if found is not None and found != config:
        changed = [
            f"{key} = {found.get(key)!r}, now {value!r}" for key, value in config.items() if found.get(key) != value
        ]
        raise TrainingError(f"{out} holds a training run with {'; '.join(changed)}; choose another --out or delete it")
    occupied = [name for name in ("dataset.json", *OWN) if (out / name).exists()]
    if found is None and occupied:
        raise TrainingError(f"{out} holds {occupied[0]}, which is not from a training run; choose another --out")
    try:
        out.mkdir(parents=True, exist_ok=True)
        for name in OWN:
            (out / name).unlink(missing_ok=True)
        (out / CONFIG).write_text(json.dumps(config, indent=2) + "\n")
    except OSError as error:
        raise StorageError(f"{out}: {error.strerror or error}") from error


def _read_config(out: Path) -> dict[str, Any] | None:
    path = out / CONFIG
    if not path.is_file():
        return None
    try:
        found = json.loads(path.read_text())
    except (OSError, ValueError) as error:
        raise TrainingError(
            f"{path} is not the configuration of a training run ({error}); choose another --out"
        ) from error
    return found if isinstance(found, dict) else {}
