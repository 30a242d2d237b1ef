"""Opening a trained policy, with one clear line about what is wrong with a file that is none."""

import pickle
from pathlib import Path
from typing import Any
from zipfile import is_zipfile

import torch

from svfl_data.errors import FormatError, TrainingError
from svfl_models.cloning.module import FORMAT, FORMAT_VERSION, CloningModule


def load_policy(path: Path | str) -> CloningModule:
    """Load a trained policy, in eval mode, on the CPU.

    Args:
        path: A ``checkpoint.ckpt`` that ``svfl-train bc`` has written.

    Returns:
        The module; ``.policy`` is the network, ``.workplace`` what it must know to act, ``.hparams`` what it was
        trained with.

    Raises:
        FormatError: If the file is missing, damaged, of another program or of another version, or if its weights do
            not fit its own description.
    """
    path = Path(path)
    found = _read(path)
    mark = found.get("svfl") if isinstance(found, dict) else None
    if not isinstance(mark, dict) or mark.get("format") != FORMAT:
        kind = mark.get("format", "nothing") if isinstance(mark, dict) else "no mark of svfl-train"
        raise FormatError(f"{path}: not a checkpoint of a policy (found {kind}, expected {FORMAT})")
    if str(mark.get("format_version")).partition(".")[0] != FORMAT_VERSION.partition(".")[0]:
        raise FormatError(
            f"{path}: format version {mark.get('format_version')}; this release reads {FORMAT_VERSION}; train it again"
        )
    try:
        module = CloningModule(**found["hyper_parameters"])
        module.load_state_dict(found["state_dict"])
    except (KeyError, TypeError, RuntimeError, TrainingError) as error:
        reason = " ".join(str(error).split())
        raise FormatError(f"{path}: weights and description do not fit each other: {reason[:200]}") from error
    return module.eval()


def is_policy(path: Path | str) -> bool:
    """Whether a file is marked as a checkpoint of a policy; false also if it cannot be read."""
    try:
        found = _read(Path(path))
    except FormatError:
        return False
    mark = found.get("svfl") if isinstance(found, dict) else None
    return isinstance(mark, dict) and mark.get("format") == FORMAT


def _read(path: Path) -> Any:  # noqa: ANN401 - whatever the file holds
    if not path.is_file():
        raise FormatError(f"{path}: no such file")
    if not is_zipfile(path):
        raise FormatError(f"{path}: not a checkpoint (or one that is cut off)")
    try:
        return torch.load(path, map_location="cpu", weights_only=True)
    except (RuntimeError, pickle.UnpicklingError, OSError, EOFError, KeyError) as error:
        raise FormatError(f"{path}: not readable as a checkpoint: {' '.join(str(error).split())[:200]}") from error
