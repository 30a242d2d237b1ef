"""Measures the quality of decoded images, from states that have seen the frames and from states that predict them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from svfl_models.latent.evaluation.frames import Followed, Frames
from svfl_models.latent.evaluation.scores import psnr
from svfl_models.latent.networks.network import LatentNetwork

HORIZON = 8
EVERY = 3
"""Predictions start at every third frame of an episode."""


@dataclass(frozen=True)
class Fidelity:
    """Similarity of decoded images to the originals, averaged over images.

    Attributes:
        psnr_db: Peak signal-to-noise ratio of colour, [dB].
        depth_mae_mm: Mean absolute error of depth where there is a measurement, [mm]; None if there is none anywhere.
    """

    psnr_db: float
    depth_mae_mm: float | None


@dataclass(frozen=True)
class Reconstruction:
    """Fidelity of different images for the same frames.

    Attributes:
        seen: Fidelity of the images decoded from the posterior state of each frame.
        mean_image: Fidelity of the mean training image, used for all frames.
        imagined: Fidelity of the images predicted 1, 2, ... steps after the last frame that the model has seen, given
            the actions.
        unmoved: Fidelity of the posterior image of the last frame seen, used for the same later frames, as if nothing
            moved.
    """

    seen: Fidelity
    mean_image: Fidelity
    imagined: list[Fidelity]
    unmoved: list[Fidelity]


def fidelity(picture: Tensor, original: Tensor) -> Fidelity:
    """Compare decoded images with originals.

    Args:
        picture: Decoded images, shape (F, 4, H, W): colour, which is clipped to 0..1, then depth in [m].
        original: Original images with the same shape; depth 0 where there is no measurement.
    """
    decibels = psnr(picture[:, :3].clamp(0, 1).numpy(), original[:, :3].numpy())
    measured = original[:, 3] > 0
    error = ((picture[:, 3] - original[:, 3]).abs() * measured).sum(dim=(1, 2))
    pixels = measured.sum(dim=(1, 2))
    depth = (error / pixels)[pixels > 0]
    return Fidelity(float(decibels.mean()), 1000 * float(depth.mean()) if len(depth) else None)


def mean_picture(frames: Frames) -> Tensor:
    """Return the mean image of frames, shape (4, H, W).

    The depth of a pixel is averaged over the frames that have a measurement there, and is 0 if none has.
    """
    image = frames.observations["image"]
    depth = image[:, 3]
    mean = depth.sum(dim=0) / (depth > 0).sum(dim=0).clamp(min=1)
    return torch.cat([image[:, :3].mean(dim=0), mean[None]])


@torch.no_grad()
def pictures(network: LatentNetwork, state: Tensor, chunk: int = 64) -> Tensor:
    """Decode states (F, Z) to images (F, 4, 64, 64), `chunk` states at a time."""
    return torch.cat([network.picture(some) for some in state.split(chunk)])


@torch.no_grad()
def reconstruction(network: LatentNetwork, followed: Sequence[Followed], mean_image: Tensor) -> Reconstruction:
    """Compare decoded and predicted images of whole episodes with the originals.

    Args:
        network: The latent model, in eval mode.
        followed: Episodes with the outputs of the model.
        mean_image: Mean image of the training episodes, shape (4, 64, 64).
    """
    originals = [one.batch["image"][0] for one in followed]
    seen = [pictures(network, one.seen.states.state[0]) for one in followed]
    horizon = min(HORIZON, max(len(one) - 1 for one in originals))
    imagined: list[Tensor] = []
    unmoved: list[Tensor] = []
    later: list[Tensor] = []
    for one, original, picture in zip(followed, originals, seen, strict=True):
        starts = np.arange(0, len(original) - horizon, EVERY)
        if not len(starts):
            continue
        window = torch.from_numpy(starts[:, None] + np.arange(horizon))  # the actions after each start
        action = network.inputs.action(one.batch["action"][0, window])
        states = network.dynamics.imagine(one.seen.states.z2[0, starts], action)
        imagined.append(pictures(network, states.flatten(0, 1)).unflatten(0, states.shape[:2]))
        unmoved.append(picture[starts][:, None].expand(-1, horizon, -1, -1, -1))
        later.append(original[window + 1])

    def by_step(kind: list[Tensor]) -> list[Fidelity]:
        joined, truth = torch.cat(kind), torch.cat(later)
        return [fidelity(joined[:, step], truth[:, step]) for step in range(horizon)]

    original = torch.cat(originals)
    return Reconstruction(
        seen=fidelity(torch.cat(seen), original),
        mean_image=fidelity(mean_image.expand_as(original), original),
        imagined=by_step(imagined),
        unmoved=by_step(unmoved),
    )
