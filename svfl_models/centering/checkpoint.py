"""Opens checkpoints of trained block-centering networks."""

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
        The module; ``.classifier`` is the network and ``.hparams`` holds the configuration that it was trained with.

    Raises:
        FormatError: If the file is missing or damaged, was written by another program or in another format version, or
            if its weights do not fit the network that it describes.

    Example:
        >>> module = load_classifier("out/centering/checkpoint.ckpt")  # doctest: +SKIP
        >>> module.classifier(batch)  # doctest: +SKIP
    """
    path = Path(path)
    found = read_marked(path, FORMAT, FORMAT_VERSION, "block-centering checkpoint")
    return rebuilt(CenteringModule, found, path, TrainingConfig)


def configuration(module: CenteringModule, data: Path | str | None = None) -> TrainingConfig:
    """Return the configuration that a network was trained with.

    Args:
        module: The network, as `load_classifier` returns it.
        data: Dataset folder that replaces the one of the training. None keeps the one of the training.
    """
    network, training = dict(module.hparams["network"]), module.hparams["training"]
    if training:
        network.pop("widths", None)  # the training tells those that differ from its preset
    kept = (training or {}) | network
    known = {field.name for field in fields(TrainingConfig)} & kept.keys()
    changed = {} if data is None else {"data": str(data)}
    return TrainingConfig(**{"data": ""} | {name: kept[name] for name in known} | changed)
