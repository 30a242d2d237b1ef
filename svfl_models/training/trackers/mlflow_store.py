"""MLflow: a file store in the folder ``mlruns`` of a training, or the server of ``MLFLOW_TRACKING_URI``."""

import json
import os
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from svfl_models.training.trackers.tracker import flat

# MLflow 3 keeps a file store only for those who ask for it (its other stores need a database), and reports to its
# makers unless it is told not to. Both are read when it is imported; what the user has set stays.
os.environ.setdefault("MLFLOW_ALLOW_FILE_STORE", "true")
os.environ.setdefault("MLFLOW_DISABLE_TELEMETRY", "true")

from mlflow.entities import Metric, Param, Run
from mlflow.tracking import MlflowClient

FOLDER = "mlruns"
EXPERIMENT = "svfl"
PICTURES = "pictures"
LONGEST_VALUE = 6000
"""Most characters of a parameter's value in MLflow."""


class MlflowStore:
    """One run of the experiment ``svfl``.

    Args:
        out: Folder of the training; its name is the name of the run.
        go_on: Whether to continue the last run of the file store of `out`, if it has one.
    """

    def __init__(self, out: Path, go_on: bool) -> None:
        server = os.environ.get("MLFLOW_TRACKING_URI")
        self._client = MlflowClient(server or (out / FOLDER).resolve().as_uri())
        found = self._client.get_experiment_by_name(EXPERIMENT)
        experiment = found.experiment_id if found else self._client.create_experiment(EXPERIMENT)
        earlier = self._last(experiment) if go_on and not server else None
        self._run: str = (earlier or self._client.create_run(experiment, run_name=out.resolve().name)).info.run_id

    def configuration(self, values: Mapping[str, Any]) -> None:
        """Log the configuration as parameters; those of a run that goes on stay as they are."""
        known = self._client.get_run(self._run).data.params
        written = {name: value if isinstance(value, str) else json.dumps(value) for name, value in flat(values).items()}
        new = [Param(name, value[:LONGEST_VALUE]) for name, value in written.items() if name not in known]
        self._client.log_batch(self._run, params=new)

    def numbers(self, values: Mapping[str, float], step: int) -> None:
        """Log numbers as metrics."""
        now = int(1000 * time.time())
        self._client.log_batch(self._run, metrics=[Metric(name, value, now, step) for name, value in values.items()])

    def picture(self, name: str, file: Path) -> None:
        """Store a picture or video as an artifact of the run."""
        self._client.log_artifact(self._run, str(file), PICTURES)

    def close(self, succeeded: bool) -> None:
        """Mark the run as finished or failed."""
        self._client.set_terminated(self._run, "FINISHED" if succeeded else "FAILED")

    def _last(self, experiment: str) -> Run | None:
        found = self._client.search_runs([experiment], max_results=1, order_by=["attributes.start_time DESC"])
        return found[0] if found else None
