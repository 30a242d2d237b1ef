"""How well pictures come back: from states that have seen them, and from states that had to imagine them."""

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
"""Imagination starts at every third frame."""


@dataclass(frozen=True)
class Fidelity:
    """How near pictures are to originals, mean over pictures.

    Attributes:
        psnr_db: Of colour, [dB].
        depth_mae_mm: Mean absolute error of depth where there is a measurement, [mm]; None if there is none anywhere.
    """

    psnr_db: float
    depth_mae_mm: float | None


@dataclass(frozen=True)
class Reconstruction:
    """Fidelity of different pictures of the same frames.

    Attributes:
        seen: From the posterior state of each frame.
        mean_image: The mean training image, whatever there is to see.
        imagined: From states 1, 2, ... steps after the last look, given the actions.
        unmoved: The posterior picture of the last look instead of the imagined ones: nothing moves.
    """

    seen: Fidelity
    mean_image: Fidelity
    imagined: list[Fidelity]
    unmoved: list[Fidelity]


def fidelity(picture: Tensor, original: Tensor) -> Fidelity:
    """Compare pictures (F, 4, H, W), colour 0..1 (cut off there) and depth in [m], with originals."""
    decibels = psnr(picture[:, :3].clamp(0, 1).numpy(), original[:, :3].numpy())
    measured = original[:, 3] > 0
    error = ((picture[:, 3] - original[:, 3]).abs() * measured).sum(dim=(1, 2))
    pixels = measured.sum(dim=(1, 2))
    depth = (error / pixels)[pixels > 0]
    return Fidelity(float(decibels.mean()), 1000 * float(depth.mean()) if len(depth) else None)


def mean_picture(frames: Frames) -> Tensor:
    """Mean image of frames, shape (4, H, W): of the depth, over those that have a measurement there."""
    image = frames.observations["image"]
    depth = image[:, 3]
    mean = depth.sum(dim=0) / (depth > 0).sum(dim=0).clamp(min=1)
    return torch.cat([image[:, :3].mean(dim=0), mean[None]])


@torch.no_grad()
def pictures(network: LatentNetwork, state: Tensor, chunk: int = 64) -> Tensor:
    """States (F, Z) -> (F, 4, 64, 64), a chunk at a time."""
    return torch.cat([network.picture(some) for some in state.split(chunk)])


@torch.no_grad()
def reconstruction(network: LatentNetwork, followed: Sequence[Followed], mean_image: Tensor) -> Reconstruction:
    """Compare pictures of followed episodes.

    Args:
        network: In eval mode.
        followed: The episodes.
        mean_image: Of the training episodes, shape (4, 64, 64).
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
