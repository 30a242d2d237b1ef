"""Lightning's training loop, made quiet and with working Ctrl-C, as every process of a training runs it."""

import logging
import signal
import threading
import warnings
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import lightning.pytorch as pl
from lightning.pytorch.callbacks import ModelCheckpoint
from lightning.pytorch.strategies import Strategy

from svfl_data.errors import StorageError
from svfl_models.training import run_folder
from svfl_models.training.checkpoint_plugin import WholeCheckpoints
from svfl_models.training.placement import Placement


@dataclass(frozen=True)
class Fit:
    """What all processes of a training do alike.

    Attributes:
        out: Folder that the checkpoint is written to.
        placement: Devices, number format and threads.
        resumed: Checkpoint of an interrupted training to continue. None starts a new training.
        deciding: Callbacks that decide how the training goes on, such as when it stops; they can be pickled.
        how: Further arguments of Lightning's Trainer, such as the number of epochs and how often to validate.
    """

    out: Path
    placement: Placement
    resumed: Path | None = None
    deciding: Sequence[pl.Callback] = ()
    how: dict[str, Any] = field(default_factory=dict)

    def __call__(
        self,
        module: pl.LightningModule,
        data: pl.LightningDataModule,
        callbacks: Sequence[pl.Callback] = (),
        strategy: Strategy | None = None,
    ) -> None:
        """Train a module in this process.

        Args:
            module: Module to train.
            data: Data to train on, and to validate on.
            callbacks: Callbacks of this process alone.
            strategy: Strategy of a process that shares the training with others; None for a training of one process.

        Raises:
            KeyboardInterrupt: If the user stopped the training (Lightning itself would end the process with code 1).
        """
        logging.getLogger("lightning.pytorch").setLevel(logging.ERROR)
        keep = ModelCheckpoint(
            dirpath=self.out,
            filename=Path(run_folder.CHECKPOINT).stem,
            enable_version_counter=False,
            save_on_train_epoch_end=True,
        )
        checkpoints = WholeCheckpoints(self.resumed)
        trainer = pl.Trainer(
            strategy=strategy or "auto",
            use_distributed_sampler=False,
            callbacks=[*callbacks, *self.deciding, keep, *([_OwnTermination()] if strategy else [])],
            logger=False,
            enable_progress_bar=False,
            enable_model_summary=False,
            num_sanity_val_steps=0,
            default_root_dir=self.out,
            plugins=[checkpoints],
            **self.placement.trainer(),
            **self.how,
        )
        interrupt = signal.getsignal(signal.SIGINT)
        try:
            with warnings.catch_warnings():
                warnings.filterwarnings("ignore", module="lightning")
                trainer.fit(module, data, ckpt_path=self.resumed, weights_only=True if self.resumed else None)
            checkpoints.finish()
        except BaseException as end:
            with suppress(StorageError):  # which would hide what has ended the training
                checkpoints.finish()
            # Lightning answers Ctrl-C with an exit.
            if isinstance(end, SystemExit) and isinstance(end.__context__, KeyboardInterrupt):
                signal.signal(signal.SIGINT, interrupt)  # Lightning has switched Ctrl-C off
                raise end.__context__ from None
            raise


class _OwnTermination(pl.Callback):
    """Handles SIGTERM during a training of several processes as it was handled before it.

    Lightning's handler would wait for an answer of the other processes while they wait for this one.
    """

    def __init__(self) -> None:
        self._before = signal.getsignal(signal.SIGTERM)

    def on_train_start(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Restore the handler; Lightning has set its own by now."""
        if threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGTERM, self._before)
