"""Running Lightning's loop as our programs need it: quietly, with Ctrl-C that arrives, and one line about the disk."""

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
    """Train a module on one device, without Lightning's advertisements; the last whole epoch is kept.

    Args:
        module: What to train.
        data: On what.
        out: Folder for the checkpoint.
        callbacks: What else is done on the way.
        resumed: Checkpoint of an interrupted training to go on from.
        each_epoch: Whether the checkpoint is written after each epoch; else only where there was a validation, too.
        how: How long, and how often to validate: further arguments of Lightning's Trainer.

    Raises:
        KeyboardInterrupt: If the user stopped it (Lightning itself would end the process with code 1).
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
            signal.signal(signal.SIGINT, interrupt)  # Lightning has switched Ctrl-C off for good
            raise KeyboardInterrupt from None
        raise


@contextmanager
def storage_errors(out: Path) -> Iterator[None]:
    """Turn the disk's refusals into one line that names the folder.

    Raises:
        StorageError: Instead of an OSError, such as a full disk.
    """
    try:
        yield
    except OSError as error:
        raise StorageError(f"{out}: {error.strerror or error}; what was written before is kept") from error


def parameter_count(module: nn.Module) -> int:
    """Number of learned numbers."""
    return sum(parameter.numel() for parameter in module.parameters() if parameter.requires_grad)
