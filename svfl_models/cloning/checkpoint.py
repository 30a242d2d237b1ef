"""Opening a trained policy."""

from pathlib import Path

from svfl_models.cloning.config import CloningConfig
from svfl_models.cloning.module import FORMAT, FORMAT_VERSION, CloningModule
from svfl_models.training.checkpoint_io import is_marked, read_marked, rebuilt


def load_policy(path: Path | str) -> CloningModule:
    """Load a trained policy, in eval mode, on the CPU.

    Args:
        path: A ``checkpoint.ckpt`` that ``svfl-train bc`` has written.

    Returns:
        The module; ``.policy`` is the network, ``.deployment`` what it must know to act, ``.hparams`` what it was
        trained with.

    Raises:
        FormatError: If the file is missing, damaged, of another program or of another version, or if its weights do
            not fit its own description.

    Example:
        >>> module = load_policy("out/bc/checkpoint.ckpt")  # doctest: +SKIP
        >>> module.policy(batch).mode  # doctest: +SKIP
    """
    path = Path(path)
    found = read_marked(path, FORMAT, FORMAT_VERSION, "checkpoint of a policy")
    return rebuilt(CloningModule, found, path, CloningConfig)


def is_policy(path: Path | str) -> bool:
    """Whether a file is marked as a checkpoint of a policy; false also if it cannot be read."""
    return is_marked(Path(path), FORMAT)
