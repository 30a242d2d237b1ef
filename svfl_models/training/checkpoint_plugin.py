"""Lightning plugin that writes checkpoints completely or not at all, and reads them without executing code in them."""

import copy
import io
import time
from pathlib import Path
from typing import Any

import torch
from lightning.fabric.plugins import CheckpointIO
from torch import Tensor

from svfl_data.errors import TrainingError
from svfl_data.system.atomic_io import write_atomically
from svfl_models.training.checkpoint_io import read

SELDOM_S = 5.0
"""Least time between two checkpoints of a training on disk, [s]. Writing one takes as long as a short epoch."""


class WholeCheckpoints(CheckpointIO):
    """Checkpoint plugin that writes a new file beside the earlier checkpoint and then renames it into place.

    Lightning's own plugin writes to the temporary folder first. Where that is on another file system, it then copies
    the new file over the earlier checkpoint, and both are lost if the disk becomes full meanwhile.

    A checkpoint that comes less than `SELDOM_S` after the last one is kept in memory. The next one replaces it, or
    `finish` writes it, so only a process that is killed loses it.

    Args:
        resumed: The only checkpoint that may be read; None means that no checkpoint may be read. Without this limit,
            Lightning would resume by itself from any file called ``hpc_ckpt_N.ckpt`` that it finds in its folder.
    """

    def __init__(self, resumed: Path | None = None) -> None:
        self._resumed = resumed
        self._written: float | None = None
        self._kept: tuple[dict[str, Any], Path] | None = None

    def save_checkpoint(self, checkpoint: dict[str, Any], path: str | Path, storage_options: object = None) -> None:
        """Write a checkpoint, or keep it in memory.

        Args:
            checkpoint: Content of the checkpoint.
            path: File to write.
            storage_options: Not used; part of Lightning's interface.

        Raises:
            StorageError: If the file cannot be written; an earlier checkpoint then stays as it was.
        """
        if self._written is not None and time.monotonic() - self._written < SELDOM_S:
            self._kept = _copied(checkpoint), Path(path)
            return
        self._kept = None
        buffer = io.BytesIO()
        torch.save(checkpoint, buffer)
        write_atomically(Path(path), buffer.getvalue())
        self._written = time.monotonic()

    def finish(self) -> None:
        """Write the checkpoint that is kept in memory, if there is one, because the training has ended.

        Raises:
            StorageError: If the file cannot be written; an earlier checkpoint then stays as it was.
        """
        if self._kept is not None:
            self._written = None
            self.save_checkpoint(*self._kept)

    def load_checkpoint(
        self, path: str | Path, map_location: object = None, weights_only: bool | None = None
    ) -> dict[str, Any]:
        """Read a checkpoint onto the CPU.

        Args:
            path: File to read.
            map_location: Not used; part of Lightning's interface.
            weights_only: Not used; nothing in a file is ever run.

        Returns:
            The content of the checkpoint.

        Raises:
            TrainingError: If `path` is not the checkpoint that this plugin may read.
            FormatError: If the file is damaged.
        """
        if self._resumed is None or Path(path) != self._resumed:
            raise TrainingError(
                f"{path} exists, but the training does not continue from it; remove it or choose another --out"
            )
        found: dict[str, Any] = read(Path(path))
        return found

    def remove_checkpoint(self, path: str | Path) -> None:
        """Remove the file of a checkpoint, if it exists."""
        Path(path).unlink(missing_ok=True)


def _copied(value: Any) -> Any:  # noqa: ANN401 - whatever a checkpoint holds
    """Return a value with copies of its tensors and containers, which go on changing in the training."""
    if isinstance(value, Tensor):
        return value.detach().clone()
    if isinstance(value, dict):
        found = copy.copy(value)  # with the versions of modules that PyTorch keeps beside a state dict
        for name, one in found.items():
            found[name] = _copied(one)
        return found
    return type(value)(map(_copied, value)) if type(value) in (list, tuple) else value
