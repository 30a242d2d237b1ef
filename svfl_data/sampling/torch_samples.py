"""The samples of a dataset for PyTorch: one by one, or in whole batches whose order depends only on the seed."""

from collections.abc import Iterator, Sequence
from typing import Any, Protocol

import numpy as np
import torch
from torch import Tensor
from torch.utils.data import DataLoader, Sampler
from torch.utils.data import Dataset as TorchDataset

from svfl_data.errors import UsageError
from svfl_data.sampling.samples import Samples, apart

TensorBatch = dict[str, Tensor]


class TorchSamples(TorchDataset[TensorBatch]):
    """`Samples` as a PyTorch dataset that works with `torch.utils.data.DataLoader`, ``Subset``, ``random_split`` and
    other tools of PyTorch. `loader` is faster than such a loader, because it does not copy single samples.

    Keys may exceed the number of samples: key k is sample k % len in epoch k // len. In this way each key also gives
    the epoch of the random crops, even in worker processes that live for many epochs.

    Args:
        samples: Samples of a dataset, which have NumPy arrays.

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
        """Return one sample, without the batch dimension."""
        if key < 0:
            raise IndexError(f"no sample {key}; there are {len(self)}, and again in every epoch")
        return self.__getitems__([key])[0]

    def __getitems__(self, keys: Sequence[int]) -> list[TensorBatch]:
        """Return a list of samples, as PyTorch's loaders request it; all keys must be of the epoch of the first key."""
        return apart(self.batch(keys), len(keys))

    def __iter__(self) -> Iterator[TensorBatch]:
        """Iterate over the samples of epoch 0; keys of further epochs would have no end."""
        return (self[key] for key in range(len(self)))

    def batch(self, keys: Sequence[int]) -> TensorBatch:
        """Return several samples as one batch.

        Args:
            keys: Keys of the samples; all must be of the epoch of the first key.

        Returns:
            Tensors by key, as described in `Samples`.

        Raises:
            UsageError: If an array holds texts, which are no tensors.
        """
        epoch = keys[0] // len(self)
        batch = self.samples.batch(np.asarray(keys) - epoch * len(self), epoch)
        for name, values in batch.items():
            if values.dtype.kind == "S":
                raise UsageError(f"{name} holds texts, and tensors hold numbers; choose other windows or vectors")
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
        """Return a loader of whole batches, which gives the same samples in the same order with any number of workers.

        Each pass over the loader is a new epoch. Lightning sets the epoch by itself; a program that resumes a training
        calls ``loader.sampler.set_epoch(epoch)``.

        Args:
            batch_size: Number of samples in each batch. The last batch has the samples that are left.
            shuffle: Whether to draw a new order of the samples in each epoch.
            seed: Seed of the order of the samples.
            drop_last: Whether to leave out a last batch that is not full.
            options: Further arguments of `torch.utils.data.DataLoader`, such as ``num_workers``. With cached images,
                no workers (``num_workers=0``) are fastest.
        """
        return whole_batches(
            self, batch_size, EpochSampler(len(self), shuffle, seed), drop_last=drop_last, **options
        )  # fmt: skip


class EpochSampler(Sampler[int]):
    """Sampler that gives the keys of one epoch in each pass, and of the following epoch in the next pass.

    Args:
        samples: Number of samples in each epoch.
        shuffle: Whether to draw a new order of the samples in each epoch.
        seed: Seed of the order of the samples.

    Attributes:
        epoch: Number of the epoch of the next pass.
    """

    def __init__(self, samples: int, shuffle: bool, seed: int) -> None:
        self.samples, self.shuffle, self.seed, self.epoch = samples, shuffle, seed, 0

    def set_epoch(self, epoch: int) -> None:
        """Set the epoch of the next pass.

        Args:
            epoch: Number of the epoch, from 0.
        """
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
    """Anything that gives whole batches of samples, such as `TorchSamples`."""

    def __len__(self) -> int: ...

    def batch(self, keys: Sequence[int]) -> TensorBatch:
        """Return the samples of the given keys as one batch."""


def whole_batches(
    samples: Batched,
    batch_size: int,
    order: Sampler[int],
    **options: Any,  # noqa: ANN401
) -> DataLoader[TensorBatch]:
    """Return a loader that fetches each batch as a whole instead of sample by sample.

    Args:
        samples: Samples to load.
        batch_size: Number of samples in each batch.
        order: Sampler of the keys of the samples.
        options: Further arguments of `torch.utils.data.DataLoader`.
    """
    return DataLoader(_Whole(samples), batch_size, sampler=order, collate_fn=_as_it_is, **options)


class _Whole(TorchDataset[TensorBatch]):
    """Dataset from which a loader fetches only whole batches."""

    def __init__(self, samples: Batched) -> None:
        self.samples = samples

    def __len__(self) -> int:
        return len(self.samples)

    def __getitems__(self, keys: Sequence[int]) -> TensorBatch:
        return self.samples.batch(keys)


def _as_it_is(batch: Any) -> Any:  # noqa: ANN401 - whatever was fetched
    """Return a batch unchanged, because a batch that was fetched as a whole needs no collating."""
    return batch
