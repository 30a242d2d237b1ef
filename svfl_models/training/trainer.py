"""Training of a module on the hardware that was asked for, and one-line messages about the disk."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import lightning.pytorch as pl
from torch import nn

from svfl_data.errors import StorageError
from svfl_models.training.distributed.followers import Rebuild, followed
from svfl_models.training.fitting import Fit
from svfl_models.training.hardware import Hardware, Needs
from svfl_models.training.placement import Placement, placed
from svfl_models.training.progress import MetricsFile
from svfl_models.training.trackers.measurements import Measurements
from svfl_models.training.trackers.trackers import NO_TRACKERS, Trackers


def run(
    module: pl.LightningModule,
    data: pl.LightningDataModule,
    out: Path,
    callbacks: Sequence[pl.Callback],
    resumed: Path | None = None,
    *,
    deciding: Sequence[pl.Callback] = (),
    placement: Placement | None = None,
    trackers: Trackers = NO_TRACKERS,
    rebuild: Rebuild | None = None,
    **how: Any,  # noqa: ANN401 - whatever Lightning takes
) -> None:
    """Train a module, without the messages that Lightning prints, and keep the checkpoint of the last epoch.

    Args:
        module: Module to train. In a training of several processes, each logged value must be a mean over the rows of
            the batch, logged with ``batch_size`` and ``sync_dist``.
        data: Data to train on, and to validate on.
        out: Folder that the checkpoint is written to.
        callbacks: Callbacks of Lightning to call during the training, in this process only. The rows of a `MetricsFile`
            among them are what trackers are given after each epoch.
        resumed: Checkpoint of an interrupted training to continue. None starts a new training.
        deciding: Callbacks that decide how the training goes on, such as when it stops; every process has them.
        placement: Devices, number format and threads; None for what `Hardware` has by default.
        trackers: Experiment trackers that the training is logged to.
        rebuild: Builds the module and the data once more, in another process; needed by a training of several
            processes.
        how: Further arguments of Lightning's Trainer, such as the number of epochs and how often to validate.

    Raises:
        KeyboardInterrupt: If the user stopped the training.
        SvflError: If a process of the training fails or dies.
    """
    placement = placement or placed(Hardware(), Needs())
    fit = Fit(out, placement, resumed, deciding, how)
    watching = [
        *callbacks,
        *(Measurements(trackers, one) for one in callbacks if isinstance(one, MetricsFile) and trackers),
    ]
    if placement.processes == 1:
        fit(module, data, watching)
        return
    assert rebuild is not None, "a training of several processes needs what builds it"
    with followed(fit, rebuild) as strategy:
        fit(module, data, watching, strategy)


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
