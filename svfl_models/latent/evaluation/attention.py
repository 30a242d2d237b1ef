"""Measures which tokens a visuo-tactile transformer attends to."""

from dataclasses import dataclass

import torch
from torch import Tensor

from svfl_models.latent.config import MODALITIES
from svfl_models.latent.evaluation.frames import CHUNK
from svfl_models.latent.networks.encoder import Parts
from svfl_models.latent.networks.vtt import Block, VTTEncoder

ASKED = 2
"""Number of tokens for alignment and contact. They come first among the tokens, and other tokens can attend to them
too."""
LOOKERS = ("contact", "alignment", "all")
Mass = dict[str, list[float]]
"""Share of the attention in each layer by group of tokens: ``asked`` (the tokens for alignment and contact), then the
modalities. The shares of a layer sum to 1 over the groups."""


@dataclass(frozen=True)
class Attention:
    """Shares of the attention on groups of tokens, averaged over heads and frames.

    Attributes:
        tokens: Share of the tokens that belong to each group, which would be the share of the attention if all tokens
            got the same.
        mass: Shares by the attending token: ``contact``, ``alignment``, or ``all`` for the mean of all tokens.
        mass_contact: The same shares for frames in contact; None if there are none.
        mass_free: The same shares for frames free of contact; None if there are none.
    """

    tokens: dict[str, float]
    mass: dict[str, Mass]
    mass_contact: dict[str, Mass] | None
    mass_free: dict[str, Mass] | None


@torch.no_grad()
def looks(encoder: VTTEncoder, parts: Parts) -> Tensor:
    """Return the attention of the contact token, the alignment token and the mean of all tokens to each token.

    Args:
        encoder: The encoder, in eval mode.
        parts: Tokens of each modality of F frames, as `VTTEncoder.parts` returns them.

    Returns:
        Mean over heads, shape (F, layers, 3, N), with the attending tokens in the order of `LOOKERS`; each row sums to
        1.
    """
    chunks = []
    for start in range(0, len(parts["proprio"]), CHUNK):
        x = encoder.tokens({name: part[start : start + CHUNK] for name, part in parts.items()})
        layers = []
        for block in encoder.blocks:
            assert isinstance(block, Block)
            attention = block.attention(x).mean(dim=1)  # (B, N, N)
            layers.append(torch.stack([attention[:, 1], attention[:, 0], attention.mean(dim=1)], dim=1))
            x = block(x)
        chunks.append(torch.stack(layers, dim=1))
    return torch.cat(chunks)


def attention(looked: Tensor, parts: Parts, contact: Tensor) -> Attention:
    """Sum the attention over the tokens of each modality.

    Args:
        looked: Result of `looks`, shape (F, layers, 3, N).
        parts: Tokens of each modality that `looked` was computed from.
        contact: Whether each frame is in contact, shape (F,), bool.
    """
    counts = {"asked": ASKED, **{name: parts[name].shape[1] for name in MODALITIES}}
    total = sum(counts.values())

    def mass(some: Tensor) -> dict[str, Mass] | None:
        if not len(some):
            return None
        mean = some.double().mean(dim=0)  # (layers, 3, N)
        groups = dict(zip(counts, mean.split(list(counts.values()), dim=-1), strict=True))
        return {
            looker: {group: tokens[:, place].sum(dim=-1).tolist() for group, tokens in groups.items()}
            for place, looker in enumerate(LOOKERS)
        }

    every = mass(looked)
    assert every is not None
    return Attention(
        tokens={group: count / total for group, count in counts.items()},
        mass=every,
        mass_contact=mass(looked[contact]),
        mass_free=mass(looked[~contact]),
    )


def over_image(looked: Tensor, patches: int) -> Tensor:
    """Return the attention of the contact token to each image patch in the last layer.

    Args:
        looked: Result of `looks`, shape (F, layers, 3, N).
        patches: Number of image tokens, a square number.

    Returns:
        Share of all attention on each patch, row by row, shape (F, side, side).
    """
    side = round(patches**0.5)
    return looked[:, -1, 0, ASKED : ASKED + patches].unflatten(1, (side, side))
