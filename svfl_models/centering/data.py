"""Batches for block centering: samples in memory, cropped as in the paper and scaled to the network's image size."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import lightning.pytorch as pl
import numpy as np
import torch
from torch import Tensor
from torch.utils.data import BatchSampler, DataLoader, Dataset, RandomSampler, Sampler, SequentialSampler

from svfl_data.errors import FormatError, TrainingError
from svfl_data.sampling.centering_samples import CenteringSamples
from svfl_models.centering.config import TrainingConfig
from svfl_models.networks.image_crops import centre_crop, crop_side, random_crop, scaled
from svfl_models.networks.inputs import CROP, INPUTS
from svfl_models.symmetry.actions import Batch, augment
from svfl_models.symmetry.groups import GROUPS
from svfl_models.training.augmentation import MARGIN, recoloured

LABELS = ("direction", "offset")
TEST_BATCH = 256
VIEWS = 16
"""Number of random crops of every training sample that are encoded in advance if the encoder is not trained."""


class Crops(Dataset[Batch]):
    """Dataset that returns samples with cropped images as batches; it is indexed with lists of sample indices.

    Args:
        samples: The samples.
        inputs: Names of the inputs that a batch holds beside the labels: ``image``, ``wrench``, ``proprio``.
        size: Height and width of the images that the network gets, [px].
        random: Whether crops lie at random positions, as in training, or at the centre of the image.
        augment: Whether the colours of images change and crops may reach beyond their edges (`training.augmentation`).
            It has no effect unless `random` is true.
        rotate: Whether every sample is rotated and mirrored by a random element of D4.
        crop: Share of the camera image's side that the images show.
    """

    def __init__(
        self,
        samples: CenteringSamples,
        inputs: Sequence[str],
        size: int = 64,
        random: bool = False,
        augment: bool = False,
        rotate: bool = False,
        crop: float = CROP,
    ) -> None:
        self.tensors = {name: torch.from_numpy(getattr(samples, name)) for name in (*inputs, *LABELS)}
        self.size, self.random, self.augment, self.rotate, self.crop = size, random, augment, rotate, crop

    def __len__(self) -> int:
        return len(self.tensors["direction"])

    def __getitem__(self, index: list[int]) -> Batch:
        """Return the samples at the positions `index` as one batch."""
        batch = {name: tensor[index] for name, tensor in self.tensors.items()}
        if "image" in batch:
            batch["image"] = self._image(batch["image"])
        return augment(batch, GROUPS["D4"]) if self.rotate else batch

    def _image(self, image: Tensor) -> Tensor:
        side = crop_side(image.shape[-1], self.size, self.crop)
        if not self.random:
            return scaled(centre_crop(image, side), self.size)
        if not self.augment:
            return scaled(random_crop(image, side), self.size)
        return recoloured(scaled(random_crop(image, side, beyond=round(MARGIN * image.shape[-1])), self.size))


class Features(Dataset[Batch]):
    """Dataset of features that a trunk computes once, for a trunk that is not trained.

    Its batches hold ``feature`` (B, F) instead of the inputs.

    Args:
        crops: Dataset of the samples.
        trunk: Function that maps a batch to features of shape (B, F).
        views: Number of crops of each sample that are encoded; each access returns the features of a random one.
    """

    def __init__(self, crops: Crops, trunk: Callable[[Batch], Tensor], views: int = 1) -> None:
        with torch.no_grad():
            seen = [torch.cat([trunk(batch) for batch in in_order(crops)]) for _ in range(views)]
        self.features = torch.stack(seen)  # (V, S, F)
        self.labels = {name: crops.tensors[name] for name in LABELS}

    def __len__(self) -> int:
        return self.features.shape[1]

    def __getitem__(self, index: list[int]) -> Batch:
        """Return the features and labels of the samples at the positions `index` as one batch."""
        view = torch.randint(len(self.features), (len(index),))
        return {"feature": self.features[view, index]} | {name: values[index] for name, values in self.labels.items()}


class ResumableShuffle(Sampler[list[int]]):
    """Sampler of shuffled batches, which uses PyTorch's random numbers and continues them in a resumed training.

    Args:
        rows: Number of samples.
        batch_size: Number of samples per batch; the last batch of an epoch may have fewer.

    Attributes:
        resumed: State of the random numbers at the end of the epoch after which the training was interrupted, which is
            restored once; None if there is nothing to restore.
    """

    def __init__(self, rows: int, batch_size: int) -> None:
        self.batches = BatchSampler(RandomSampler(range(rows)), batch_size, drop_last=False)
        self.resumed: Tensor | None = None

    def __len__(self) -> int:
        return len(self.batches)

    def __iter__(self) -> Iterator[list[int]]:
        """Yield the indices of the batches of one epoch."""
        if self.resumed is not None:
            torch.set_rng_state(self.resumed)
            torch.empty((), dtype=torch.int64).random_()  # as PyTorch's loader draws before each epoch
            self.resumed = None
        yield from self.batches


class CenteringData(pl.LightningDataModule):
    """Training and test batches of block centering.

    Its state in a checkpoint is that of PyTorch's random numbers at the end of an epoch, which the order of the samples
    and their crops depend on. A training that is resumed there gives the same result, bit for bit, as an uninterrupted
    one.

    Args:
        train: Samples to train on.
        test: Samples to test on.
        config: Configuration that gives the inputs, the image size, the augmentation and the batch size.
        valid: Samples by whose accuracy the training stops; None if it stops by the test samples, or not at all.

    Raises:
        TrainingError: If an input holds NaN or infinity, or images are not square or are smaller than those of the
            network.
    """

    def __init__(
        self,
        train: CenteringSamples,
        test: CenteringSamples,
        config: TrainingConfig,
        valid: CenteringSamples | None = None,
    ) -> None:
        super().__init__()
        held_out = [test] if valid is None else [test, valid]
        for samples in (train, *held_out):
            check_samples(samples, config)
        inputs, size = INPUTS[config.encoder], config.image_size
        self.crops = [Crops(train, inputs, size, True, config.augment, config.rotate, config.crop)]
        self.crops += [Crops(some, inputs, size, crop=config.crop) for some in held_out]
        self.train_set: Crops | Features = self.crops[0]
        self.held_out: Sequence[Crops | Features] = self.crops[1:]
        self.order = ResumableShuffle(len(train), config.batch_size)

    def state_dict(self) -> dict[str, Any]:
        """Return the state of the random numbers, for the checkpoint."""
        return {"random": torch.get_rng_state()}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Continue with the random numbers of a checkpoint.

        Raises:
            FormatError: If the checkpoint holds something else in their place.
        """
        try:
            state = torch.as_tensor(state_dict.get("random"))
            torch.Generator().set_state(state)
        except (RuntimeError, TypeError, ValueError) as error:
            raise FormatError(
                "the checkpoint holds no random numbers to continue with; choose another --out"
            ) from error
        self.order.resumed = state

    def encode(self, trunk: Callable[[Batch], Tensor]) -> None:
        """Replace the samples by the features that a trunk computes from them, for a trunk that is not trained.

        Args:
            trunk: Function that maps a batch to features of shape (B, F).
        """
        self.train_set = Features(self.crops[0], trunk, VIEWS)
        self.held_out = [Features(some, trunk) for some in self.crops[1:]]

    def train_dataloader(self) -> DataLoader[Batch]:
        """Return a loader of shuffled training batches with random crops."""
        return DataLoader(self.train_set, sampler=self.order, batch_size=None)

    def val_dataloader(self) -> list[DataLoader[Batch]]:
        """Return a loader of the test samples and, if there are any, one of the validation samples.

        The stopping rule of the paper reads the test accuracy, and Lightning computes it in its validation.
        """
        return [in_order(some) for some in self.held_out]


def in_order(samples: Crops | Features) -> DataLoader[Batch]:
    """Return a loader of batches of all samples, in their order."""
    return DataLoader(samples, sampler=BatchSampler(SequentialSampler(samples), TEST_BATCH, False), batch_size=None)


def check_samples(samples: CenteringSamples, config: TrainingConfig) -> None:
    """Refuse samples that a training cannot use, before its first step.

    Args:
        samples: The samples to check.
        config: Configuration that gives the inputs and the image size.

    Raises:
        TrainingError: If an input holds NaN or infinity, or images are not square or are smaller than those of the
            network.
    """
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
