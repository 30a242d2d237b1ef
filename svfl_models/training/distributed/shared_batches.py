"""Lightning strategy of processes that each take their rows of the same batch."""

from typing import Any, Protocol, runtime_checkable

import torch
from lightning.fabric.plugins.environments import LightningEnvironment
from lightning.pytorch.strategies import DDPStrategy
from torch import Tensor


def share(rows: int, rank: int, processes: int) -> slice:
    """Return which rows of a batch a process takes.

    The processes take equal shares, which differ by one row at most. A batch of fewer rows than processes goes whole to
    each of them, for no mean can be taken of no rows; it then counts once per process in the means of an epoch.

    Args:
        rows: Number of rows of the batch.
        rank: Number of the process.
        processes: Number of processes.
    """
    if rows < processes:
        return slice(0, rows)
    return slice(rows * rank // processes, rows * (rank + 1) // processes)


@runtime_checkable
class WholeBatches(Protocol):
    """A module whose rows are not independent, which is given whole batches and computes its own rows itself."""

    def take_rows(self, rows: slice, whole: int) -> None:
        """Note which rows of the next batch, of `whole` rows, this process computes."""


class SharedBatches(DDPStrategy):
    """Distributed data parallel training whose steps are those of one process, apart from rounding.

    Every process makes every batch as a whole, with the same random numbers, and keeps its share of the rows. A loss is
    a mean over rows, so each is weighted by its share before the gradients are averaged. In this way neither the order
    of the samples nor the random crops depend on the number of processes. Lightning's own way splits the samples before
    they are batched, and gives other batches, and counts some samples twice where they cannot be split evenly. A module
    with `WholeBatches` keeps the whole batch and is told its rows.

    The process group must exist, and each process must have been started by the caller.

    Args:
        rank: Number of this process.
        processes: Number of processes.
    """

    def __init__(self, rank: int, processes: int) -> None:
        # Buffers are statistics of the inputs, which no step changes.
        super().__init__(cluster_environment=_ThisMachine(rank), broadcast_buffers=False)
        self.rank, self.count, self.weight = rank, processes, 1.0

    def batch_to_device(self, batch: Any, device: torch.device | None = None, dataloader_idx: int = 0) -> Any:  # noqa: ANN401
        """Keep this process's rows of a batch, a dictionary of tensors of the shape (B, ...), on its device."""
        rows = len(next(iter(batch.values())))
        mine = share(rows, self.rank, self.count)
        self.weight = 1.0 if rows < self.count else (mine.stop - mine.start) * self.count / rows
        if isinstance(self.lightning_module, WholeBatches):
            self.lightning_module.take_rows(mine, rows)
            return super().batch_to_device(batch, device, dataloader_idx)
        return super().batch_to_device({name: values[mine] for name, values in batch.items()}, device, dataloader_idx)

    def configure_ddp(self) -> None:
        """Expect that each step uses every parameter, but for modules whose losses may leave out terms."""
        self._ddp_kwargs["find_unused_parameters"] = isinstance(self.lightning_module, WholeBatches)
        super().configure_ddp()

    def training_step(self, *arguments: Any, **named: Any) -> Tensor:  # noqa: ANN401 - as Lightning declares it
        """Return the loss of this process's rows, weighted by their share of the batch."""
        loss = super().training_step(*arguments, **named)
        assert isinstance(loss, Tensor)
        return loss * self.weight

    def reduce(self, tensor: Any, group: Any = None, reduce_op: Any = "mean") -> Any:  # noqa: ANN401 - as above
        """Reduce a tensor over the processes; a mean of integers is not rounded, unlike Lightning's."""
        if reduce_op == "mean" and isinstance(tensor, Tensor) and not tensor.is_floating_point():
            tensor = tensor.double()
        return super().reduce(tensor, group, reduce_op)

    def setup_distributed(self) -> None:
        """Take the ranks from the process group; unlike Lightning's, do not set the random numbers back to the seed."""
        self.set_world_ranks()

    def _configure_launcher(self) -> None:
        """Launch nothing: the processes run already."""


class _ThisMachine(LightningEnvironment):
    """Processes that the caller has started on this machine."""

    def __init__(self, rank: int) -> None:
        super().__init__()
        self._rank = rank

    @property
    def creates_processes_externally(self) -> bool:
        """Always true."""
        return True

    def local_rank(self) -> int:
        """Return the number of this process."""
        return self._rank
