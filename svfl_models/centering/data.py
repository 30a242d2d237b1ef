"""Batches for block centering: samples in memory, cropped as in the paper and scaled to the network's size."""

from collections.abc import Callable, Sequence

import lightning.pytorch as pl
import numpy as np
import torch
from torch import Tensor
from torch.utils.data import BatchSampler, DataLoader, Dataset, RandomSampler, SequentialSampler

from svfl_data.errors import TrainingError
from svfl_data.sampling.centering_samples import CenteringSamples
from svfl_models.centering.config import TrainingConfig
from svfl_models.networks.image_crops import centre_crop, crop_side, random_crop, scaled
from svfl_models.networks.inputs import INPUTS
from svfl_models.networks.visual_force import Batch
from svfl_models.symmetry.actions import augment
from svfl_models.symmetry.groups import GROUPS
from svfl_models.training.augmentation import MARGIN, recoloured

LABELS = ("direction", "offset")
TEST_BATCH = 256
VIEWS = 16
"""So many crops of every training sample are encoded where the encoder does not learn."""


class Crops(Dataset[Batch]):
    """Samples as batches, asked for with lists of indices.

    Args:
        samples: What to serve.
        inputs: Fields to put into a batch, beside the labels.
        size: Height and width of the images that the network sees, [px].
        random: Crop at random (training) rather than at the centre (test).
        augment: Change places and colours of the images (`augmentation`).
        rotate: Turn and mirror every sample by a random element of D4.
    """

    def __init__(
        self,
        samples: CenteringSamples,
        inputs: Sequence[str],
        size: int = 64,
        random: bool = False,
        augment: bool = False,
        rotate: bool = False,
    ) -> None:
        self.tensors = {name: torch.from_numpy(getattr(samples, name)) for name in (*inputs, *LABELS)}
        self.size, self.random, self.augment, self.rotate = size, random, augment, rotate

    def __len__(self) -> int:
        return len(self.tensors["direction"])

    def __getitem__(self, index: list[int]) -> Batch:
        """The samples of `index` as one batch."""
        batch = {name: tensor[index] for name, tensor in self.tensors.items()}
        if "image" in batch:
            batch["image"] = self._image(batch["image"])
        return augment(batch, GROUPS["D4"]) if self.rotate else batch

    def _image(self, image: Tensor) -> Tensor:
        side = crop_side(image.shape[-1], self.size)
        if not self.random:
            return scaled(centre_crop(image, side), self.size)
        if not self.augment:
            return scaled(random_crop(image, side), self.size)
        return recoloured(scaled(random_crop(image, side, beyond=round(MARGIN * image.shape[-1])), self.size))


class Features(Dataset[Batch]):
    """What a trunk that does not learn makes of samples, computed once; batches have ``feature`` (B, F) for inputs.

    Args:
        crops: The samples.
        trunk: Batches of them -> features.
        views: Crops of each sample; which one is served, is drawn.
    """

    def __init__(self, crops: Crops, trunk: Callable[[Batch], Tensor], views: int = 1) -> None:
        with torch.no_grad():
            seen = [torch.cat([trunk(batch) for batch in in_order(crops)]) for _ in range(views)]
        self.features = torch.stack(seen)  # (V, S, F)
        self.labels = {name: crops.tensors[name] for name in LABELS}

    def __len__(self) -> int:
        return self.features.shape[1]

    def __getitem__(self, index: list[int]) -> Batch:
        """The samples of `index` as one batch."""
        view = torch.randint(len(self.features), (len(index),))
        return {"feature": self.features[view, index]} | {name: values[index] for name, values in self.labels.items()}


class CenteringData(pl.LightningDataModule):
    """Training and test batches of block centering.

    Args:
        train: Samples to learn from.
        test: Samples to test on.
        config: Inputs, image size, augmentation and batch size.

    Raises:
        TrainingError: If an input has NaN or infinity, or images are not square or smaller than the network's.
    """

    def __init__(self, train: CenteringSamples, test: CenteringSamples, config: TrainingConfig) -> None:
        super().__init__()
        for samples in (train, test):
            check_samples(samples, config)
        inputs, size = INPUTS[config.encoder], config.image_size
        self.crops = Crops(train, inputs, size, True, config.augment, config.rotate), Crops(test, inputs, size)
        self.train_set: Crops | Features = self.crops[0]
        self.test_set: Crops | Features = self.crops[1]
        self.batch_size = config.batch_size

    def encode(self, trunk: Callable[[Batch], Tensor]) -> None:
        """From now on serve what a trunk makes of the samples: for one that does not learn."""
        self.train_set, self.test_set = Features(self.crops[0], trunk, VIEWS), Features(self.crops[1], trunk)

    def train_dataloader(self) -> DataLoader[Batch]:
        """Shuffled batches with random crops."""
        return DataLoader(
            self.train_set, sampler=BatchSampler(RandomSampler(self.train_set), self.batch_size, False), batch_size=None
        )

    def val_dataloader(self) -> DataLoader[Batch]:
        """The test samples; Lightning validates on them because the paper's stopping rule reads the test accuracy."""
        return in_order(self.test_set)


def in_order(samples: Crops | Features) -> DataLoader[Batch]:
    """Batches of all samples, in their order."""
    return DataLoader(samples, sampler=BatchSampler(SequentialSampler(samples), TEST_BATCH, False), batch_size=None)


def check_samples(samples: CenteringSamples, config: TrainingConfig) -> None:
    """Refuse samples that would poison the training, before its first step."""
    for name in INPUTS[config.encoder]:
        bad = ~np.isfinite(getattr(samples, name)).reshape(len(samples), -1).all(axis=1)
        if bad.any():
            episode = int(samples.episode[bad][0])
            raise TrainingError(f"{name} of episode {episode} holds NaN or infinity ({int(bad.sum())} such samples)")
    if "v" in config.encoder:
        height, width = samples.image.shape[-2:]
        if height != width:
            raise TrainingError(f"images are {height} x {width} pixels; needed: square ones")
        crop_side(height, config.image_size)
