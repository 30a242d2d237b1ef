"""Batches for block centering: samples in memory, cropped 76 -> 64."""

from collections.abc import Sequence

import lightning.pytorch as pl
import numpy as np
import torch
from torch import Tensor
from torch.utils.data import BatchSampler, DataLoader, Dataset, RandomSampler, SequentialSampler

from svfl_data.centering import CenteringSamples
from svfl_data.errors import TrainingError
from svfl_models.classifier import Batch
from svfl_models.encoders import IMAGE_SIZE

INPUTS = {"v": ("image",), "f": ("wrench",), "vf": ("image", "wrench")}
"""What each encoder looks at; the rest is left out of the batches."""


class Crops(Dataset[Batch]):
    """Samples as batches, asked for with lists of indices.

    Args:
        samples: What to serve.
        inputs: Fields to put into a batch, beside the ``direction``.
        random: Crop at random (training) rather than at the centre (test); Kohler et al., CoRL 2023, appendix.
    """

    def __init__(self, samples: CenteringSamples, inputs: Sequence[str], random: bool) -> None:
        self.tensors = {name: torch.from_numpy(getattr(samples, name)) for name in (*inputs, "direction")}
        self.random = random

    def __len__(self) -> int:
        return len(self.tensors["direction"])

    def __getitem__(self, index: list[int]) -> Batch:
        """The samples of `index` as one batch."""
        batch = {name: tensor[index] for name, tensor in self.tensors.items()}
        if "image" in batch:
            batch["image"] = random_crop(batch["image"]) if self.random else centre_crop(batch["image"])
        return batch


def centre_crop(image: Tensor, size: int = IMAGE_SIZE) -> Tensor:
    """The middle of square images: (B, C, H, H) -> (B, C, size, size)."""
    start = (image.shape[-1] - size) // 2
    return image[..., start : start + size, start : start + size]


def random_crop(image: Tensor, size: int = IMAGE_SIZE) -> Tensor:
    """A part of each square image at its own random place: (B, C, H, H) -> (B, C, size, size)."""
    places = image.shape[-1] - size + 1
    corner = torch.randint(places, (len(image), 2))
    rows, columns = (corner[:, k, None] + torch.arange(size) for k in (0, 1))  # (B, size) each
    sample = torch.arange(len(image))[:, None, None]
    pixels = image.movedim(1, -1)[sample, rows[:, :, None], columns[:, None, :]]  # (B, size, size, C)
    return pixels.movedim(-1, 1)


class CenteringData(pl.LightningDataModule):
    """Training and test batches of block centering.

    Args:
        train: Samples to learn from.
        test: Samples to test on.
        encoder: ``v``, ``f`` or ``vf``: what to put into the batches.
        batch_size: Samples per batch.

    Raises:
        TrainingError: If an input has NaN or infinity, or images are not square or smaller than the crop.
    """

    def __init__(self, train: CenteringSamples, test: CenteringSamples, encoder: str, batch_size: int = 64) -> None:
        super().__init__()
        for samples in (train, test):
            check_samples(samples)
        self.train_set = Crops(train, INPUTS[encoder], random=True)
        self.test_set = Crops(test, INPUTS[encoder], random=False)
        self.batch_size = batch_size

    def train_dataloader(self) -> DataLoader[Batch]:
        """Shuffled batches with random crops."""
        return DataLoader(
            self.train_set, sampler=BatchSampler(RandomSampler(self.train_set), self.batch_size, False), batch_size=None
        )

    def val_dataloader(self) -> DataLoader[Batch]:
        """The test samples; Lightning validates on them because the paper's stopping rule reads the test accuracy."""
        return DataLoader(
            self.test_set, sampler=BatchSampler(SequentialSampler(self.test_set), 256, False), batch_size=None
        )


def check_samples(samples: CenteringSamples) -> None:
    """Refuse samples that would poison the training, before its first step."""
    for name in ("image", "wrench"):
        bad = ~np.isfinite(getattr(samples, name)).reshape(len(samples), -1).all(axis=1)
        if bad.any():
            episode = int(samples.episode[bad][0])
            raise TrainingError(f"{name} of episode {episode} holds NaN or infinity ({int(bad.sum())} such samples)")
    height, width = samples.image.shape[-2:]
    if height != width or height < IMAGE_SIZE:
        raise TrainingError(
            f"images are {height} x {width} pixels; needed: square, at least {IMAGE_SIZE} x {IMAGE_SIZE}"
        )
