"""The samples of a dataset for PyTorch: whole batches of tensors, in an order that only the seed decides."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.utils.data import DataLoader, Sampler
from torch.utils.data import Dataset as TorchDataset

from svfl_data.samples import Samples

TensorBatch = dict[str, Tensor]


class TorchSamples(TorchDataset[TensorBatch]):
    """`Samples` as a PyTorch dataset of whole batches.

    Its keys run beyond the number of samples: key k is sample k % len in epoch k // len. The epoch of a random crop
    travels with the key in this way, also to worker processes that live as long as the loader.
    """

    def __init__(self, samples: Samples) -> None:
        self.samples = samples

    def __len__(self) -> int:
        return len(self.samples)

    def __getitem__(self, key: int) -> TensorBatch:
        """One sample, without the batch dimension."""
        if key < 0:
            raise IndexError(f"no sample {key}; there are {len(self)}, and again in every epoch")
        return {name: values[0] for name, values in self.__getitems__([key]).items()}

    def __getitems__(self, keys: Sequence[int]) -> TensorBatch:
        """A whole batch; all keys from the epoch of the first."""
        epoch = keys[0] // len(self)
        batch = self.samples.batch(np.asarray(keys) - epoch * len(self), epoch)
        return {name: torch.from_numpy(values) for name, values in batch.items()}

    def loader(
        self,
        batch_size: int,
        *,
        shuffle: bool,
        seed: int = 0,
        drop_last: bool = False,
        **options: Any,  # noqa: ANN401
    ) -> DataLoader[TensorBatch]:
        """A loader of whole batches: the same samples in the same order, whatever the number of workers.

        Each pass is an epoch of its own; Lightning sets the epoch by itself, a program that resumes calls
        ``loader.sampler.set_epoch(epoch)``.

        Args:
            batch_size: Samples per batch; the last batch has what is left.
            shuffle: Whether to draw a new order in each epoch.
            seed: Of the order.
            drop_last: Whether to leave out a last batch that is not full.
            options: For `torch.utils.data.DataLoader`, such as ``num_workers``. With cached images, none are fastest.
        """
        return DataLoader(
            self, batch_size, sampler=EpochSampler(len(self), shuffle, seed), collate_fn=as_it_is, drop_last=drop_last,
            **options,
        )  # fmt: skip


class EpochSampler(Sampler[int]):
    """The keys of one epoch after the other.

    Attributes:
        epoch: Of the next pass.
    """

    def __init__(self, samples: int, shuffle: bool, seed: int) -> None:
        self.samples, self.shuffle, self.seed, self.epoch = samples, shuffle, seed, 0

    def set_epoch(self, epoch: int) -> None:
        """Make the next pass that of an epoch."""
        self.epoch = epoch

    def __len__(self) -> int:
        return self.samples

    def __iter__(self) -> Iterator[int]:
        epoch, self.epoch = self.epoch, self.epoch + 1
        order = np.arange(self.samples)
        if self.shuffle:
            order = np.random.default_rng([self.seed, epoch]).permutation(self.samples)
        yield from (order + epoch * self.samples).tolist()


def as_it_is(batch: Any) -> Any:  # noqa: ANN401 - whatever was fetched
    """A batch that was fetched whole needs no collating."""
    return batch
