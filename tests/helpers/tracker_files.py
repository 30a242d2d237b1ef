"""What experiment trackers have written, read back with their own libraries as far as these can read it."""

import json
import struct
import time
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tests.helpers.patience import PATIENCE

Series = dict[str, list[tuple[int, float]]]
"""Numbers by name, as (step, value)."""
HEADER, BLOCK = 7, 32768
FULL, FIRST, LAST = 1, 2, 4


def tensorboard_numbers(out: Path) -> tuple[Series, dict[str, list[bytes]]]:
    """Scalars, and encoded images by name."""
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    events = EventAccumulator(str(out / "tensorboard")).Reload()
    tags = events.Tags()
    return (
        {name: [(one.step, one.value) for one in events.Scalars(name)] for name in tags["scalars"]},
        {name: [one.encoded_image_string for one in events.Images(name)] for name in tags["images"]},
    )


def mlflow_runs(out: Path) -> list[tuple[dict[str, str], Series, list[str], str]]:
    """Parameters, metrics, artifacts and status of each run."""
    from mlflow.tracking import MlflowClient

    client = MlflowClient((out / "mlruns").resolve().as_uri())
    found = []
    for run in client.search_runs([client.get_experiment_by_name("svfl").experiment_id]):
        key = run.info.run_id
        series = {
            name: [(one.step, one.value) for one in client.get_metric_history(key, name)] for name in run.data.metrics
        }
        artifacts = [one.path for one in client.list_artifacts(key, "pictures")]
        found.append((run.data.params, series, artifacts, run.info.status))
    return found


def wandb_runs(out: Path) -> list[tuple[str, dict, Series, dict[str, Path]]]:
    """Id, configuration, numbers and media files of each offline folder, the oldest first."""
    found = []
    for file in sorted(out.glob("wandb/offline-run-*/*.wandb"), key=lambda file: file.stat().st_mtime):
        series: Series = defaultdict(list)
        config, media = {}, {}
        for kind, record in _whole_run(file):
            if kind in ("run", "config"):
                told = record.run.config if kind == "run" else record.config
                config |= {"/".join(one.nested_key) or one.key: json.loads(one.value_json) for one in told.update}
            if kind == "history":
                row = {"/".join(one.nested_key) or one.key: json.loads(one.value_json) for one in record.history.item}
                for name, value in row.items():
                    if name.endswith("/path"):
                        media[name.removesuffix("/path")] = file.parent / "files" / value
                    elif not name.startswith("_") and name != "step" and isinstance(value, int | float):
                        series[name].append((row["step"], value))
        found.append((file.stem.removeprefix("run-"), config, dict(series), media))
    return found


def _whole_run(file: Path) -> list[tuple[str, Any]]:
    """Kind and content of each record of a run that has ended; W&B's own process writes the last ones after it."""
    from wandb.proto.wandb_internal_pb2 import Record

    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        records = [Record.FromString(data) for data in _records(file.read_bytes())]
        kinds = [record.WhichOneof("record_type") for record in records]
        if "exit" in kinds:
            return list(zip(kinds, records, strict=True))
        time.sleep(0.1)
    raise AssertionError(f"{file} has no end")


def _records(content: bytes) -> Iterator[bytes]:
    """Records of a file in LevelDB's log format, which W&B writes: blocks of 32 KiB, records cut at their ends."""
    position, parts = HEADER, b""
    while position + HEADER <= len(content):
        if BLOCK - position % BLOCK < HEADER:  # the end of a block, too small for the head of a record
            position += BLOCK - position % BLOCK
            continue
        _, length, kind = struct.unpack_from("<IHB", content, position)
        position += HEADER
        piece, position = content[position : position + length], position + length
        if len(piece) < length:  # not all of it is written yet
            return
        parts = piece if kind in (FULL, FIRST) else parts + piece
        if kind in (FULL, LAST):
            yield parts
