"""Whether a model tells frames with their own wrench from frames with another, by how far apart the two are."""

from dataclasses import dataclass

import torch
from torch import Tensor

from svfl_models.latent.evaluation.frames import CHUNK, Encoded, Frames
from svfl_models.latent.evaluation.scores import auroc
from svfl_models.latent.mismatch import allowed_pairs
from svfl_models.latent.networks.network import LatentNetwork

GAPS = (1, 2, 4, 8, 16)
PAIRS = 200
"""Of each kind, at most."""


@dataclass(frozen=True)
class Told:
    """Pairs of one kind.

    Attributes:
        pairs: How many there were to evaluate.
        rejected: Share that the model says are wrong.
        auroc: How well they are told from the same frames with their own wrench.
    """

    pairs: int
    rejected: float
    auroc: float | None


@dataclass(frozen=True)
class Alignment:
    """What a model makes of right and wrong pairs.

    Attributes:
        accepted: Share of all frames whose own wrench is accepted.
        accepted_touching: Likewise of those in contact.
        by_gap: Frames with a wrench from so many steps earlier or later in their episode; a gap that no pair has is
            left out.
        other_episodes: Frames with the wrench of another episode; None if there is no such pair.
    """

    accepted: float
    accepted_touching: float | None
    by_gap: dict[int, Told]
    other_episodes: Told | None


def alignment(network: LatentNetwork, frames: Frames, encoded: Encoded, seed: int) -> Alignment:
    """Show frames with other wrenches; pairs of two frames free of contact cannot be told and are not asked.

    Args:
        network: In eval mode.
        frames: Of whole episodes.
        encoded: What the encoder said about them, parts included.
        seed: Of the pairs, where there are more than `PAIRS` of a kind.
    """
    episode, step = frames.episode, frames.step
    allowed = allowed_pairs(episode, step, frames.touching, gap=1)
    same = episode[:, None] == episode
    apart = (step[:, None] - step).abs()
    own = encoded.alignment
    touching = own[frames.touching]
    rng = torch.Generator().manual_seed(seed)

    def told(wanted: Tensor) -> Told | None:
        pairs = (allowed & wanted).nonzero()
        if not len(pairs):
            return None
        image, wrench = pairs[torch.randperm(len(pairs), generator=rng)[:PAIRS]].T
        foreign = _shown(network, encoded, image, wrench)
        scores, truth = torch.cat([own[image], foreign]), torch.arange(2 * len(image)) < len(image)
        return Told(len(image), float((foreign < 0.5).float().mean()), auroc(scores.numpy(), truth.numpy()))

    by_gap = {gap: told(same & (apart == gap)) for gap in GAPS}
    return Alignment(
        accepted=float((own > 0.5).float().mean()),
        accepted_touching=float((touching > 0.5).float().mean()) if len(touching) else None,
        by_gap={gap: one for gap, one in by_gap.items() if one is not None},
        other_episodes=told(~same),
    )


@torch.no_grad()
def _shown(network: LatentNetwork, encoded: Encoded, image: Tensor, wrench: Tensor) -> Tensor:
    """Probability of alignment of frames `image` with the wrenches of frames `wrench`; proprio is the image's."""
    logits = []
    for some_image, some_wrench in zip(image.split(CHUNK), wrench.split(CHUNK), strict=True):
        parts = {name: part[some_wrench if name == "wrench" else some_image] for name, part in encoded.parts.items()}
        logits.append(network.encoder.join(parts).alignment)
    return torch.cat(logits).sigmoid()
