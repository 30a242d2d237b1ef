"""Opens checkpoints of trained policies."""

from pathlib import Path

from svfl_models.cloning.config import CloningConfig
from svfl_models.cloning.module import FORMAT, FORMAT_VERSION, CloningModule
from svfl_models.training.checkpoint_io import is_marked, read_marked, rebuilt


def load_policy(path: Path | str) -> CloningModule:
    """Load a trained policy, in eval mode, on the CPU.

    Args:
        path: A ``checkpoint.ckpt`` that ``svfl-train bc`` has written.

    Returns:
        The module; ``.policy`` is the network, ``.deployment`` holds what the policy needs of its demonstrations to
        act, and ``.hparams`` holds the configuration that the policy was trained with.

    Raises:
        FormatError: If the file is missing or damaged, was written by another program or in another format version, or
            if its weights do not fit the network that it describes.

    Example:
        >>> module = load_policy("out/bc/checkpoint.ckpt")  # doctest: +SKIP
        >>> module.policy(batch).mode  # doctest: +SKIP
    """
    path = Path(path)
    found = read_marked(path, FORMAT, FORMAT_VERSION, "checkpoint of a policy")
    return rebuilt(CloningModule, found, path, CloningConfig)


def is_policy(path: Path | str) -> bool:
    """Return whether a file is marked as a checkpoint of a policy; false also if the file cannot be read."""
    return is_marked(Path(path), FORMAT)
