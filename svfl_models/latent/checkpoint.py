"""Opening a pretrained latent model."""

from pathlib import Path
from typing import Any

from svfl_data.errors import FormatError
from svfl_models.latent.config import LatentConfig
from svfl_models.latent.module import FORMAT, FORMAT_VERSION, LatentModule
from svfl_models.training.checkpoint_io import read_marked, rebuilt


def load_latent(path: Path | str) -> LatentModule:
    """Load a pretrained model, in eval mode, on the CPU.

    Args:
        path: A ``checkpoint.ckpt`` that ``svfl-train latent`` has written.

    Returns:
        The module: ``.network.encode`` makes features of observations; ``.hparams["training"]`` says what it was
        trained with, ``.hparams["split"]`` on which episodes.

    Raises:
        FormatError: If the file is missing, damaged, of another program or of another version, or if its weights do
            not fit its own description.

    Example:
        >>> module = load_latent("out/latent_poe/checkpoint.ckpt")  # doctest: +SKIP
    """
    path = Path(path)
    return rebuilt(LatentModule, read_latent(path), path, LatentConfig)


def read_latent(path: Path) -> dict[str, Any]:
    """What a checkpoint of latent pretraining holds, its mark checked.

    Raises:
        FormatError: As `load_latent`.
    """
    found = read_marked(path, FORMAT, FORMAT_VERSION, "checkpoint of latent pretraining")
    if type(found["svfl"].get("steps")) is not int:
        raise FormatError(f"{path}: does not say after how many steps it was written")
    return found
