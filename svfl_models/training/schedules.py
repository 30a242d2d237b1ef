"""The courses of the learning rate over a training. This module is light to import."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from torch.optim import Optimizer
    from torch.optim.lr_scheduler import LRScheduler

SCHEDULES = ("cosine", "constant")


def scheduler(optimizer: "Optimizer", schedule: str, length: int) -> "LRScheduler":
    """Return the scheduler of a learning rate.

    Args:
        optimizer: Optimiser whose learning rates change.
        schedule: One of `SCHEDULES`. ``cosine`` falls to zero along half a cosine (Loshchilov & Hutter, ICLR 2017, one
            cycle); ``constant`` stays.
        length: Number of epochs or steps, whichever the scheduler is called after, of the whole training.
    """
    from torch.optim import lr_scheduler  # torch takes seconds to import

    if schedule == "constant":
        return lr_scheduler.ConstantLR(optimizer, factor=1.0, total_iters=0)
    return lr_scheduler.CosineAnnealingLR(optimizer, length)
