"""How Lightning writes and reads checkpoints here: whole or not at all, and without running what is in them."""

import io
from pathlib import Path
from typing import Any

import torch
from lightning.fabric.plugins import CheckpointIO

from svfl_data.errors import TrainingError
from svfl_data.system.atomic_io import write_atomically
from svfl_models.training.checkpoint_io import read


class WholeCheckpoints(CheckpointIO):
    """Writes beside the earlier checkpoint and then takes its name.

    Lightning's own way writes to the temporary folder first; where that is another file system, it then copies over
    the earlier checkpoint, and a disk that is full meanwhile costs both.

    Args:
        resumed: The one checkpoint that may be read. Lightning goes on by itself from any file that it finds in its
            folder under the name ``hpc_ckpt_N.ckpt``.
    """

    def __init__(self, resumed: Path | None = None) -> None:
        self._resumed = resumed

    def save_checkpoint(self, checkpoint: dict[str, Any], path: str | Path, storage_options: object = None) -> None:
        """Write a checkpoint.

        Raises:
            StorageError: If the disk refuses; an earlier checkpoint is untouched.
        """
        buffer = io.BytesIO()
        torch.save(checkpoint, buffer)
        write_atomically(Path(path), buffer.getvalue())

    def load_checkpoint(
        self, path: str | Path, map_location: object = None, weights_only: bool | None = None
    ) -> dict[str, Any]:
        """Read a checkpoint onto the CPU.

        Raises:
            TrainingError: If nobody has asked for this one.
            FormatError: If it is damaged.
        """
        if self._resumed is None or Path(path) != self._resumed:
            raise TrainingError(
                f"{path} is there, but nobody asked to go on from it; remove it or choose another --out"
            )
        found: dict[str, Any] = read(Path(path))
        return found

    def remove_checkpoint(self, path: str | Path) -> None:
        """Remove a checkpoint."""
        Path(path).unlink(missing_ok=True)
