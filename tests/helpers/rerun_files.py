"""What stands in a file for Rerun."""

import numpy as np
from rerun.chunk import RrdReader


def entities(path):
    return {chunk.entity_path for chunk in RrdReader(path).stream().to_chunks()}


def logged(path, entity, component, timed=True):
    """Rows of one component and their times, as written in the file."""
    for chunk in RrdReader(path).stream().to_chunks():
        batch = chunk.to_record_batch()
        if chunk.entity_path == f"/{entity}" and component in batch.schema.names and chunk.is_static != timed:
            rows = batch.column(component).to_pylist()
            return (batch.column("time").cast("int64").to_numpy(), np.array(rows)) if timed else rows[0]
    raise AssertionError(f"{entity} has no {component}")


def encoded(path, entity, component):
    for chunk in RrdReader(path).stream().to_chunks():
        batch = chunk.to_record_batch()
        if chunk.entity_path == f"/{entity}" and component in batch.schema.names and not chunk.is_static:
            return [bytes(row[0]) for row in batch.column(component).to_pylist()]
    raise AssertionError(f"{entity} has no {component}")


def gathered(path, entity, component):
    """Rows of a component over all pieces, by time."""
    times, rows = [], []
    for chunk in RrdReader(path).stream().to_chunks():
        batch = chunk.to_record_batch()
        if chunk.entity_path == f"/{entity}" and component in batch.schema.names and not chunk.is_static:
            times += batch.column("time").cast("int64").to_pylist()
            rows += batch.column(component).to_pylist()
    order = np.argsort(times)
    return np.array(times)[order], [rows[row] for row in order]
