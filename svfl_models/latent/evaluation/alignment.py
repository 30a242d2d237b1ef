"""Measures how well a model distinguishes frames with their own wrench from frames with the wrench of another time."""

from dataclasses import dataclass

import torch
from torch import Tensor

from svfl_models.latent.evaluation.frames import CHUNK, Encoded, Frames
from svfl_models.latent.evaluation.scores import auroc
from svfl_models.latent.mismatch import allowed_pairs
from svfl_models.latent.networks.network import LatentNetwork

GAPS = (1, 2, 4, 8, 16)
PAIRS = 200
"""Largest number of pairs of each kind."""


@dataclass(frozen=True)
class PairScores:
    """Result for the mismatched pairs of one kind.

    Attributes:
        pairs: Number of pairs that were evaluated.
        rejected: Share of the pairs that the model rejects as mismatched, 0..1.
        auroc: Area under the receiver operating characteristic of the alignment, between these pairs and the same
            frames with their own wrench.
    """

    pairs: int
    rejected: float
    auroc: float | None


@dataclass(frozen=True)
class Alignment:
    """Evaluation of a model on matched and mismatched pairs of image and wrench.

    Attributes:
        accepted: Share of all frames that the model accepts with their own wrench, 0..1.
        accepted_touching: The same share of the frames in contact; None if there are none.
        by_gap: Results for frames with the wrench of another frame of the same episode, by the distance of the two
            frames in steps. A distance without pairs is left out.
        other_episodes: Result for frames with the wrench of another episode; None if there is no such pair.
    """

    accepted: float
    accepted_touching: float | None
    by_gap: dict[int, PairScores]
    other_episodes: PairScores | None


def alignment(network: LatentNetwork, frames: Frames, encoded: Encoded, seed: int) -> Alignment:
    """Evaluate frames with the wrenches of other frames.

    Pairs of two frames that are both free of contact are left out, because their wrenches cannot be distinguished.

    Args:
        network: The latent model, in eval mode.
        frames: Frames of whole episodes.
        encoded: Output of the encoder for these frames, including `Encoded.parts`.
        seed: Seed of the choice of pairs, for kinds with more than `PAIRS` pairs.
    """
    episode, step = frames.episode, frames.step
    allowed = allowed_pairs(episode, step, frames.touching, gap=1)
    same = episode[:, None] == episode
    apart = (step[:, None] - step).abs()
    own = encoded.alignment
    touching = own[frames.touching]
    rng = torch.Generator().manual_seed(seed)

    def scores_of(wanted: Tensor) -> PairScores | None:
        pairs = (allowed & wanted).nonzero()
        if not len(pairs):
            return None
        image, wrench = pairs[torch.randperm(len(pairs), generator=rng)[:PAIRS]].T
        foreign = _shown(network, encoded, image, wrench)
        scores, truth = torch.cat([own[image], foreign]), torch.arange(2 * len(image)) < len(image)
        return PairScores(len(image), float((foreign < 0.5).float().mean()), auroc(scores.numpy(), truth.numpy()))

    by_gap = {gap: scores_of(same & (apart == gap)) for gap in GAPS}
    return Alignment(
        accepted=float((own > 0.5).float().mean()),
        accepted_touching=float((touching > 0.5).float().mean()) if len(touching) else None,
        by_gap={gap: one for gap, one in by_gap.items() if one is not None},
        other_episodes=scores_of(~same),
    )


@torch.no_grad()
def _shown(network: LatentNetwork, encoded: Encoded, image: Tensor, wrench: Tensor) -> Tensor:
    """Return the probability of alignment of the frames `image` with the wrenches of the frames `wrench`.

    Image and proprioception are those of the frames `image`.
    """
    logits = []
    for some_image, some_wrench in zip(image.split(CHUNK), wrench.split(CHUNK), strict=True):
        parts = {name: part[some_wrench if name == "wrench" else some_image] for name, part in encoded.parts.items()}
        logits.append(network.encoder.join(parts).alignment)
    return torch.cat(logits).sigmoid()
