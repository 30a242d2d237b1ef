"""Batches of demonstrated steps for a policy with inputs and an action of the user's own."""

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor
from torch.utils.data import DataLoader
from torch.utils.data import Dataset as TorchDataset

from svfl_data.datasets.dataset import Dataset
from svfl_data.sampling.samples import Samples, apart
from svfl_data.sampling.torch_samples import EpochSampler, whole_batches
from svfl_data.signals import pictures
from svfl_data.symmetry import act
from svfl_models.cloning.config import CloningConfig
from svfl_models.cloning.deployment_spec import DeploymentSpec
from svfl_models.cloning.recorded_inputs import RecordedInput, of_plain, windows
from svfl_models.networks.action_space import ActionSpace
from svfl_models.networks.image_crops import centre_crop, crop_side, random_crop, scaled, turned
from svfl_models.networks.input_types import actions_of
from svfl_models.symmetry.actions import Batch, act_on_parts, augment
from svfl_models.symmetry.groups import GROUPS
from svfl_models.training.augmentation import MARGIN, recoloured

STATISTICS = 1024
"""Largest number of steps that the scales of the inputs are computed from."""


class OwnDemonstrations(TorchDataset[Batch]):
    """Dataset of all steps of some episodes: each input by its path, and ``action`` (B, C), image-aligned axes.

    The keys run beyond the number of steps, as in `cloning.data.Demonstrations`.

    Args:
        dataset: Dataset to read the episodes from.
        episodes: Indices of the episodes.
        deployment: What the episodes have in common, with `inputs` and `action`.
        config: Configuration that gives the image size, the augmentation and the seed.
        random: Whether images are cropped at random and steps are rotated at random (`CloningConfig.rotate`), as in
            training, or images are cropped in the middle.
    """

    def __init__(
        self, dataset: Dataset, episodes: Sequence[int], deployment: DeploymentSpec, config: CloningConfig, random: bool
    ) -> None:
        assert deployment.action is not None
        self.inputs, self.config, self.random = of_plain(deployment.inputs), config, random
        self.axes, self.space = np.array(deployment.image_axes), ActionSpace.of_plain(deployment.action)
        self.action = config.action
        self.moves = actions_of([one.network() for one in self.inputs]) | {"action": act_on_parts(self.space.parts)}
        self.samples = Samples(
            dataset, episodes, cameras=cameras(self.inputs), windows=windows(self.inputs),
            vectors=[one.path for one in self.inputs if one.kind == "vector"], actions=[self.action],
            expert_action=True, cache=True, validated=False,
        )  # fmt: skip

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
        batch = {"action": torch.from_numpy(act(self.axes, recorded[self.action][:, 0], self.space.parts))}
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(int(np.random.SeedSequence([self.config.seed, keys[0]]).generate_state(1)[0]))
            for one in self.inputs:
                if one.kind == "image":
                    batch[one.path] = self._image(placed(one, picture(one, recorded), recorded, self.axes))
                    continue
                matrix, offset, turn = (torch.from_numpy(part).float() for part in one.maps(self.axes))
                values = torch.from_numpy(recorded[one.path]).float().reshape(len(keys), *one.shape)
                batch[one.path] = (values - offset) @ matrix + turn
            return augment(batch, GROUPS["D4"], self.moves) if self.random and self.config.rotate else batch

    def loader(self, batch_size: int, workers: int = 0) -> DataLoader[Batch]:
        """Return a loader of batches of all steps, in a new random order in every epoch if crops are random.

        Args:
            batch_size: Number of steps per batch.
            workers: Number of processes that prepare batches; the batches are the same with any number.
        """
        order = EpochSampler(len(self), self.random, self.config.seed)
        return whole_batches(self, batch_size, order, num_workers=workers, persistent_workers=workers > 0)

    def typical(self) -> Batch:
        """Return at most `STATISTICS` steps, spread evenly over the episodes, for the scales of the inputs."""
        return self.batch(np.linspace(0, len(self) - 1, min(len(self), STATISTICS)).astype(int).tolist())

    def _image(self, image: Tensor) -> Tensor:
        size, height = self.config.image_size, image.shape[-1]
        side = crop_side(height, size, self.config.crop)
        if not self.random:
            return scaled(centre_crop(image, side), size)
        beyond = round(MARGIN * height) if self.config.augment else 0
        image = scaled(random_crop(image, side, beyond), size)
        return recoloured(image) if self.config.augment and image.shape[1] == 4 else image


def cameras(inputs: Sequence[RecordedInput]) -> list[str]:
    """Return the names of the cameras of a policy's inputs."""
    return [one.path.removeprefix("cameras/") for one in inputs if one.kind == "image"]


def picture(one: RecordedInput, recorded: dict[str, np.ndarray]) -> Tensor:
    """Return recorded images as input of a policy: colour and grey 0..1, depth in [m], (B, channels, H, W), float32.

    Args:
        one: The input.
        recorded: Batch of samples, with images (B, 1, H, W, ...).
    """
    images = {leaf: recorded[f"{one.path}/{leaf}"][:, 0] for leaf in one.images}
    return torch.from_numpy(pictures.picture(images, one.depth_scale))


def placed(one: RecordedInput, image: Tensor, recorded: dict[str, np.ndarray], axes: np.ndarray) -> Tensor:
    """Return the middle squares of images, rotated into the axes of the policy if their camera moves.

    Args:
        one: The input.
        image: Images of the input, shape (B, C, H, W).
        recorded: Batch of samples, with the image axes (B, 1, 2, 2) of a camera that moves.
        axes: Matrix from base (x, y) to image-aligned (right, up), shape (2, 2).
    """
    image = square(image)
    if one.axes is None:
        return image
    return turned(image, torch.from_numpy(axes @ recorded[one.axes][:, 0].transpose(0, 2, 1)).to(image))


def square(image: Tensor) -> Tensor:
    """Return the middle square of images.

    Args:
        image: Images, shape (B, C, H, W).

    Returns:
        The squares, shape (B, C, S, S), where S is the smaller of H and W.
    """
    height, width = image.shape[-2:]
    side = min(height, width)
    top, left = (height - side) // 2, (width - side) // 2
    return image[..., top : top + side, left : left + side]
