"""Opening a trained block-centering network."""

from dataclasses import fields
from pathlib import Path

from svfl_models.centering.config import TrainingConfig
from svfl_models.centering.module import FORMAT, FORMAT_VERSION, CenteringModule
from svfl_models.training.checkpoint_io import read_marked, rebuilt


def load_classifier(path: Path | str) -> CenteringModule:
    """Load a trained block-centering network, in eval mode, on the CPU.

    Args:
        path: A ``checkpoint.ckpt`` that ``svfl-train centering`` has written.

    Returns:
        The module; ``.classifier`` is the network, ``.hparams`` what it was trained with.

    Raises:
        FormatError: If the file is missing, damaged, of another program or of another version, or if its weights do
            not fit its own description.

    Example:
        >>> module = load_classifier("out/centering/checkpoint.ckpt")  # doctest: +SKIP
        >>> module.classifier(batch)  # doctest: +SKIP
    """
    path = Path(path)
    found = read_marked(path, FORMAT, FORMAT_VERSION, "block-centering checkpoint")
    return rebuilt(CenteringModule, found, path, TrainingConfig)


def configuration(module: CenteringModule, data: Path | str | None = None) -> TrainingConfig:
    """What a network was trained with; with other data if some are given."""
    kept = (module.hparams["training"] or {}) | module.hparams["network"]
    known = {field.name for field in fields(TrainingConfig)} & kept.keys()
    changed = {} if data is None else {"data": str(data)}
    return TrainingConfig(**{"data": ""} | {name: kept[name] for name in known} | changed)
