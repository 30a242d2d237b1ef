"""Batches of demonstrated steps: the observation before each action, and the action."""

from collections.abc import Sequence

import lightning.pytorch as pl
import numpy as np
import torch
from torch import Tensor
from torch.utils.data import DataLoader
from torch.utils.data import Dataset as TorchDataset

from svfl_data.checks import check_usable
from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import DatasetError
from svfl_data.sampling.named_camera import named_camera
from svfl_data.sampling.samples import ACTION, PROPRIO, WRENCH, Samples, apart
from svfl_data.sampling.split import split_episodes
from svfl_data.sampling.torch_samples import EpochSampler, whole_batches
from svfl_data.signals.pictures import camera_picture
from svfl_data.symmetry import ACTION_PARTS, PROPRIO_PARTS, WRENCH_PARTS, act
from svfl_models.cloning.config import CloningConfig
from svfl_models.cloning.deployment_spec import DeploymentSpec, deployment_of, deployment_of_own
from svfl_models.cloning.gripper_view import JITTER, corners
from svfl_models.cloning.own_data import OwnDemonstrations
from svfl_models.networks.image_crops import centre_crop, crop_at, crop_side, random_crop, scaled
from svfl_models.symmetry.actions import Batch, augment
from svfl_models.symmetry.groups import GROUPS
from svfl_models.training.augmentation import MARGIN, WHITE, recoloured

VALID_BATCH = 256
STATISTICS = 1024
"""Largest number of steps that the scales of the inputs are computed from."""


class Demonstrations(TorchDataset[Batch]):
    """Dataset of all steps of some episodes: inputs of `policy.Policy` and ``action`` (B, 5), image-aligned axes.

    Actions are scaled so that the bounds of the demonstrations become those of the paper, which the network has
    (`DeploymentSpec.unit`).

    The keys run beyond the number of steps: key k is step k % len in epoch k // len, as in
    `svfl_data.sampling.torch_samples.TorchSamples`. The random choices of a batch depend only on the seed and on the
    first key of the batch, so that a training that is interrupted and resumed gives the same result as an uninterrupted
    one. Images are kept in memory as they were recorded, uint8 and uint16, and are converted when a batch is made.

    Args:
        dataset: Dataset to read the episodes from.
        episodes: Indices of the episodes.
        deployment: What the episodes have in common, as `deployment_of` returns it.
        config: Configuration that gives the inputs, the image size, the view, the augmentation and the seed.
        random: Whether crops are shifted at random and steps are rotated at random (`CloningConfig.rotate`), as in
            training, or crops lie exactly around the gripper or the centre of the image.

    Raises:
        DatasetError: If the images do not fit into memory.
        FieldError: If an episode lacks a field.
    """

    def __init__(
        self, dataset: Dataset, episodes: Sequence[int], deployment: DeploymentSpec, config: CloningConfig, random: bool
    ) -> None:
        self.sees = "v" in config.encoder
        cameras = [deployment.camera] if self.sees else []
        self.feels = "f" in config.encoder
        windows = {WRENCH: config.window} if self.feels else {}
        self.samples = Samples(
            dataset, episodes, cameras=cameras, windows=windows, vectors=[PROPRIO], actions=[ACTION],
            expert_action=True, cache=True, validated=False,
        )  # fmt: skip
        self.deployment, self.config, self.random = deployment, config, random
        self.axes = np.array(deployment.image_axes)
        self.projection = torch.tensor(deployment.projection, dtype=torch.float32)
        self.side = crop_side(deployment.image_side, config.image_size, config.crop) if self.sees else 0

    def __len__(self) -> int:
        return len(self.samples)

    def __getitem__(self, key: int) -> Batch:
        """Return the step of one key, without the batch dimension."""
        if key < 0:
            raise IndexError(f"no step {key}; there are {len(self)}, and again in every epoch")
        return self.__getitems__([key])[0]

    def __getitems__(self, keys: Sequence[int]) -> list[Batch]:
        """Return the steps of many keys one by one, as PyTorch's loaders ask for them."""
        return apart(self.batch(keys), len(keys))

    def batch(self, keys: Sequence[int]) -> Batch:
        """Return the steps of many keys as one batch."""
        recorded = self.samples.batch(np.asarray(keys) % len(self))
        proprio = recorded[PROPRIO]
        known = torch.from_numpy(proprio.copy())
        proprio[:, 1:3] -= np.array(self.deployment.centre, np.float32)
        batch = {
            "proprio": torch.from_numpy(act(self.axes, proprio, PROPRIO_PARTS)),
            "action": torch.from_numpy(act(self.axes, recorded[ACTION][:, 0] / self.deployment.unit, ACTION_PARTS)),
        }
        if self.feels:
            wrench = recorded[WRENCH]
            if self.random and self.config.noise:
                draw = np.random.default_rng([self.config.seed, keys[0]]).standard_normal(wrench.shape)
                wrench = (wrench + self.config.noise * np.array(WHITE) * draw).astype(np.float32)
            batch["wrench"] = torch.from_numpy(act(self.axes, wrench, WRENCH_PARTS))
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(int(np.random.SeedSequence([self.config.seed, keys[0]]).generate_state(1)[0]))
            if self.sees:
                image = torch.from_numpy(camera_picture(recorded, self.deployment.camera, self.deployment.depth_scale))
                batch["image"] = self._image(image, known)
            return augment(batch, GROUPS["D4"]) if self.random and self.config.rotate else batch

    def loader(self, batch_size: int, workers: int = 0) -> DataLoader[Batch]:
        """Return a loader of batches of all steps.

        The order is a new random one in every epoch if crops are random, and the order of the episodes otherwise.

        Args:
            batch_size: Number of steps per batch.
            workers: Number of processes that prepare batches; the batches are the same with any number.
        """
        order = EpochSampler(len(self), self.random, self.config.seed)
        return whole_batches(self, batch_size, order, num_workers=workers, persistent_workers=workers > 0)

    def typical(self) -> Batch:
        """Return at most `STATISTICS` steps, spread evenly over the episodes, for the scales of the inputs."""
        return self.batch(np.linspace(0, len(self) - 1, min(len(self), STATISTICS)).astype(int).tolist())

    def _image(self, image: Tensor, proprio: Tensor) -> Tensor:
        size = self.config.image_size
        if self.config.view == "gripper":
            corner = corners(proprio, self.projection, self.deployment.table, image.shape[-1], self.side)
            if not self.random:
                return scaled(crop_at(image, corner, self.side), size)
            image = scaled(crop_at(image, corner + torch.randint(-JITTER, JITTER + 1, corner.shape), self.side), size)
            return recoloured(image) if self.config.augment else image
        if not self.random:
            return scaled(centre_crop(image, self.side), size)
        if not self.config.augment:
            return scaled(random_crop(image, self.side), size)
        return recoloured(scaled(random_crop(image, self.side, beyond=round(MARGIN * image.shape[-1])), size))


class CloningData(pl.LightningDataModule):
    """Training and validation batches of behaviour cloning.

    Args:
        config: Configuration that gives the demonstrations and how batches are made from them.
        loader_workers: Number of processes that prepare training batches.

    Attributes:
        deployment: What the demonstrations have in common.

    Raises:
        SvflError: If the demonstrations cannot be used: if there are too few, if they differ in what a policy depends
            on, if an episode is damaged or if it lacks a field.
    """

    def __init__(self, config: CloningConfig, loader_workers: int = 0) -> None:
        super().__init__()
        self.loader_workers = loader_workers
        dataset = Dataset.open(config.data)
        chosen = successful(dataset, config.episodes)
        if config.inputs:
            self._take_own(dataset, chosen, config)
            return
        uses = ["streams/wrench"] if "f" in config.encoder else []
        if "v" in config.encoder:
            first = dataset.episode(chosen[0])
            uses += [f"cameras/{named_camera(first.cameras, config.camera, first.extent)}"]
        check_usable(dataset, chosen, uses)
        self.deployment = deployment_of(dataset, chosen, config.camera, config.encoder)
        split = split_episodes(chosen, {"train": 1 - config.valid, "valid": config.valid}, config.seed)
        self.train_set: Demonstrations | OwnDemonstrations
        self.valid_set: Demonstrations | OwnDemonstrations
        self.train_set = Demonstrations(dataset, split["train"], self.deployment, config, random=True)
        self.valid_set = Demonstrations(dataset, split["valid"], self.deployment, config, random=False)
        self.batch_size = config.batch_size

    def _take_own(self, dataset: Dataset, chosen: Sequence[int], config: CloningConfig) -> None:
        """Prepare batches of inputs and an action of the user's own."""
        symmetric = config.group != "none" or config.rotate  # either must know how each input transforms
        self.deployment = deployment_of_own(dataset, chosen, config.inputs, config.action, symmetric)
        groups = {one["path"] if one["kind"] == "image" else one["path"].rpartition("/")[0]
                  for one in self.deployment.inputs}  # fmt: skip
        check_usable(dataset, chosen, sorted(groups))
        split = split_episodes(chosen, {"train": 1 - config.valid, "valid": config.valid}, config.seed)
        self.train_set = OwnDemonstrations(dataset, split["train"], self.deployment, config, random=True)
        self.valid_set = OwnDemonstrations(dataset, split["valid"], self.deployment, config, random=False)
        self.batch_size = config.batch_size

    def train_dataloader(self) -> DataLoader[Batch]:
        """Return a loader of shuffled training batches with random crops."""
        return self.train_set.loader(self.batch_size, self.loader_workers)

    def val_dataloader(self) -> DataLoader[Batch]:
        """Return a loader of the held-out episodes, in their order."""
        return self.valid_set.loader(VALID_BATCH)


def successful(dataset: Dataset, count: int) -> list[int]:
    """Return the indices of the first episodes in which the task was achieved.

    Args:
        dataset: Dataset to search.
        count: Number of episodes to return, at least 2, because a split needs two.

    Raises:
        DatasetError: If the dataset has fewer successful episodes, or `count` is less than 2.
    """
    found: list[int] = []
    for index in dataset.indices:
        if len(found) < count and dataset.episode(index).meta.success:
            found.append(index)
    if len(found) < count:
        raise DatasetError(
            f"{dataset.path}: asked for {count} successful episodes, but it has {len(found)} among {len(dataset)}; "
            "--episodes asks for fewer"
        )
    if count < 2:
        raise DatasetError(f"{dataset.path}: asked for {count} episode; needed: one to learn from and one held out")
    return found
