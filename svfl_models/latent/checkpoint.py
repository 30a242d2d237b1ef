"""Opening a pretrained latent model, with one clear line about what is wrong with a file that is none."""

import pickle
from pathlib import Path
from typing import Any
from zipfile import is_zipfile

import torch

from svfl_data.errors import FormatError, SvflError
from svfl_models.latent.module import FORMAT, FORMAT_VERSION, LatentModule


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
    """
    path = Path(path)
    found = read_latent(path)
    try:
        module = LatentModule(**found["hyper_parameters"])
        module.load_state_dict(found["state_dict"])
    except (KeyError, TypeError, RuntimeError, SvflError) as error:
        reason = " ".join(str(error).split())
        raise FormatError(f"{path}: weights and description do not fit each other: {reason[:200]}") from error
    return module.eval()


def read_latent(path: Path) -> dict[str, Any]:
    """What a checkpoint of latent pretraining holds, its mark checked.

    Raises:
        FormatError: As `load_latent`.
    """
    found = _read(path)
    mark = found.get("svfl") if isinstance(found, dict) else None
    if not isinstance(mark, dict) or mark.get("format") != FORMAT:
        kind = mark.get("format", "nothing") if isinstance(mark, dict) else "no mark of svfl-train"
        raise FormatError(f"{path}: not a checkpoint of latent pretraining (found {kind}, expected {FORMAT})")
    if str(mark.get("format_version")).partition(".")[0] != FORMAT_VERSION.partition(".")[0]:
        raise FormatError(
            f"{path}: format version {mark.get('format_version')}; this release reads {FORMAT_VERSION}; train it again"
        )
    return found


def _read(path: Path) -> Any:  # noqa: ANN401 - whatever the file holds
    if not path.is_file():
        raise FormatError(f"{path}: no such file")
    if not is_zipfile(path):
        raise FormatError(f"{path}: not a checkpoint (or one that is cut off)")
    try:
        return torch.load(path, map_location="cpu", weights_only=True)
    except (RuntimeError, pickle.UnpicklingError, OSError, EOFError, KeyError) as error:
        raise FormatError(f"{path}: not readable as a checkpoint: {' '.join(str(error).split())[:200]}") from error
