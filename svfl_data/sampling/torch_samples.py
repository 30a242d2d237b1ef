"""The samples of a dataset for PyTorch: one by one, or whole batches in an order that only the seed decides."""

from collections.abc import Iterator, Sequence
from typing import Any, Protocol

import numpy as np
import torch
from torch import Tensor
from torch.utils.data import DataLoader, Sampler
from torch.utils.data import Dataset as TorchDataset

from svfl_data.sampling.samples import Samples, apart

TensorBatch = dict[str, Tensor]


class TorchSamples(TorchDataset[TensorBatch]):
    """`Samples` as a PyTorch dataset, for `torch.utils.data.DataLoader` as it stands, ``Subset``, ``random_split`` and
    the like. `loader` is faster: it copies nothing sample by sample.

    Its keys run beyond the number of samples: key k is sample k % len in epoch k // len. The epoch of a random crop
    travels with the key in this way, also to worker processes that live as long as the loader.

    Example:
        >>> samples = TorchSamples(Samples(dataset))
        >>> loader = torch.utils.data.DataLoader(samples, batch_size=8)
        >>> next(iter(loader))["actions/action"].shape
        torch.Size([8, 1, 5])
    """  # noqa: D205

    def __init__(self, samples: Samples) -> None:
        self.samples = samples

    def __len__(self) -> int:
        return len(self.samples)

    def __getitem__(self, key: int) -> TensorBatch:
        """One sample, without the batch dimension."""
        if key < 0:
            raise IndexError(f"no sample {key}; there are {len(self)}, and again in every epoch")
        return self.__getitems__([key])[0]

    def __getitems__(self, keys: Sequence[int]) -> list[TensorBatch]:
        """Many samples, one by one, as PyTorch's loaders ask for them; all keys from the epoch of the first."""
        return apart(self.batch(keys), len(keys))

    def __iter__(self) -> Iterator[TensorBatch]:
        """The samples of epoch 0: the keys themselves have no end."""
        return (self[key] for key in range(len(self)))

    def batch(self, keys: Sequence[int]) -> TensorBatch:
        """Many samples as one batch; all keys from the epoch of the first."""
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
        return whole_batches(
            self, batch_size, EpochSampler(len(self), shuffle, seed), drop_last=drop_last, **options
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


class Batched(Protocol):
    """What gives whole batches."""

    def __len__(self) -> int: ...

    def batch(self, keys: Sequence[int]) -> TensorBatch:
        """The samples of keys as one batch."""


def whole_batches(
    samples: Batched,
    batch_size: int,
    order: Sampler[int],
    **options: Any,  # noqa: ANN401
) -> DataLoader[TensorBatch]:
    """A loader that fetches each batch whole.

    Args:
        samples: Where from.
        batch_size: Samples per batch.
        order: Keys of the samples.
        options: For `torch.utils.data.DataLoader`.
    """
    return DataLoader(_Whole(samples), batch_size, sampler=order, collate_fn=_as_it_is, **options)


class _Whole(TorchDataset[TensorBatch]):
    """A dataset whose samples are only asked for in whole batches."""

    def __init__(self, samples: Batched) -> None:
        self.samples = samples

    def __len__(self) -> int:
        return len(self.samples)

    def __getitems__(self, keys: Sequence[int]) -> TensorBatch:
        return self.samples.batch(keys)


def _as_it_is(batch: Any) -> Any:  # noqa: ANN401 - whatever was fetched
    """A batch that was fetched whole needs no collating."""
    return batch
