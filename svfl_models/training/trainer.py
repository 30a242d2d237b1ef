"""Running of Lightning's training loop, made quiet, with working Ctrl-C and one-line messages about the disk."""

import logging
import signal
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import lightning.pytorch as pl
from lightning.pytorch.callbacks import ModelCheckpoint
from lightning.pytorch.trainer.states import TrainerStatus
from torch import nn

from svfl_data.errors import StorageError
from svfl_models.training import run_folder
from svfl_models.training.checkpoint_plugin import WholeCheckpoints


def run(
    module: pl.LightningModule,
    data: pl.LightningDataModule,
    out: Path,
    callbacks: Sequence[pl.Callback],
    resumed: Path | None = None,
    each_epoch: bool = True,
    **how: Any,  # noqa: ANN401 - whatever Lightning takes
) -> None:
    """Train a module on one device, without the messages that Lightning prints, and keep the last checkpoint.

    Args:
        module: Module to train.
        data: Data to train on, and to validate on.
        out: Folder that the checkpoint is written to.
        callbacks: Callbacks of Lightning to call during the training.
        resumed: Checkpoint of an interrupted training to continue. None starts a new training.
        each_epoch: Whether a checkpoint is written after each epoch. If false, it is written only after epochs with a
            validation.
        how: Further arguments of Lightning's Trainer, such as the number of epochs and how often to validate.

    Raises:
        KeyboardInterrupt: If the user stopped the training (Lightning itself would end the process with code 1).
    """
    logging.getLogger("lightning.pytorch").setLevel(logging.ERROR)
    keep = ModelCheckpoint(
        dirpath=out,
        filename=Path(run_folder.CHECKPOINT).stem,
        enable_version_counter=False,
        save_on_train_epoch_end=True if each_epoch else None,
    )
    trainer = pl.Trainer(
        accelerator="auto",
        devices=1,
        callbacks=[*callbacks, keep],
        logger=False,
        enable_progress_bar=False,
        enable_model_summary=False,
        num_sanity_val_steps=0,
        default_root_dir=out,
        plugins=[WholeCheckpoints(resumed)],
        **how,
    )
    interrupt = signal.getsignal(signal.SIGINT)
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", module="lightning")
            trainer.fit(module, data, ckpt_path=resumed, weights_only=True if resumed else None)
    except SystemExit:
        if trainer.state.status == TrainerStatus.INTERRUPTED:
            signal.signal(signal.SIGINT, interrupt)  # Lightning has switched Ctrl-C off
            raise KeyboardInterrupt from None
        raise


@contextmanager
def storage_errors(out: Path) -> Iterator[None]:
    """Convert an OSError in the context, such as a full disk, to an error with a one-line message.

    Args:
        out: Folder to name in the message.

    Raises:
        StorageError: If an OSError was raised in the context.
    """
    try:
        yield
    except OSError as error:
        raise StorageError(f"{out}: {error.strerror or error}; what was written before is kept") from error


def parameter_count(module: nn.Module) -> int:
    """Return how many numbers of a module are learned."""
    return sum(parameter.numel() for parameter in module.parameters() if parameter.requires_grad)
