"""Opens checkpoints of pretrained latent models."""

from pathlib import Path
from typing import Any

from svfl_data.errors import FormatError
from svfl_models.latent.config import LatentConfig
from svfl_models.latent.module import FORMAT, FORMAT_VERSION, LatentModule
from svfl_models.training.checkpoint_io import read_marked, rebuilt


def load_latent(path: Path | str) -> LatentModule:
    """Load a pretrained latent model, in eval mode, on the CPU.

    Args:
        path: A ``checkpoint.ckpt`` that ``svfl-train latent`` has written.

    Returns:
        The module; ``.network.encode`` maps observations to features, ``.hparams["training"]`` holds the configuration
        of the training, and ``.hparams["split"]`` holds the episodes of each part of the data.

    Raises:
        FormatError: If the file is missing or damaged, was written by another program or in another format version, or
            if its weights do not fit the network that it describes.

    Example:
        >>> module = load_latent("out/latent_poe/checkpoint.ckpt")  # doctest: +SKIP
    """
    path = Path(path)
    return rebuilt(LatentModule, read_latent(path), path, LatentConfig)


def read_latent(path: Path) -> dict[str, Any]:
    """Return the content of a checkpoint of latent pretraining, after checking its format and version.

    Args:
        path: The checkpoint file.

    Raises:
        FormatError: If the file is missing or damaged, was written by another program or in another format version, or
            does not say after how many steps it was written.
    """
    found = read_marked(path, FORMAT, FORMAT_VERSION, "checkpoint of latent pretraining")
    if type(found["svfl"].get("steps")) is not int:
        raise FormatError(f"{path}: does not say after how many steps it was written")
    return found
