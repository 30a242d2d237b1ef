"""Lightning plugin that writes checkpoints completely or not at all, and reads them without executing code in them."""

import io
from pathlib import Path
from typing import Any

import torch
from lightning.fabric.plugins import CheckpointIO

from svfl_data.errors import TrainingError
from svfl_data.system.atomic_io import write_atomically
from svfl_models.training.checkpoint_io import read


class WholeCheckpoints(CheckpointIO):
    """Checkpoint plugin that writes a new file beside the earlier checkpoint and then renames it into place.

    Lightning's own plugin writes to the temporary folder first. Where that is on another file system, it then copies
    the new file over the earlier checkpoint, and both are lost if the disk becomes full meanwhile.

    Args:
        resumed: The only checkpoint that may be read; None means that no checkpoint may be read. Without this limit,
            Lightning would resume by itself from any file called ``hpc_ckpt_N.ckpt`` that it finds in its folder.
    """

    def __init__(self, resumed: Path | None = None) -> None:
        self._resumed = resumed

    def save_checkpoint(self, checkpoint: dict[str, Any], path: str | Path, storage_options: object = None) -> None:
        """Write a checkpoint.

        Args:
            checkpoint: Content of the checkpoint.
            path: File to write.
            storage_options: Not used; part of Lightning's interface.

        Raises:
            StorageError: If the file cannot be written; an earlier checkpoint then stays as it was.
        """
        buffer = io.BytesIO()
        torch.save(checkpoint, buffer)
        write_atomically(Path(path), buffer.getvalue())

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
