"""Which tokens a visuo-tactile transformer looks at."""

from dataclasses import dataclass

import torch
from torch import Tensor

from svfl_models.latent.config import MODALITIES
from svfl_models.latent.evaluation.frames import CHUNK
from svfl_models.latent.networks.encoder import Parts
from svfl_models.latent.networks.vtt import Block, VTTEncoder

ASKED = 2
"""The tokens of alignment and contact come first; they can be looked at too."""
LOOKERS = ("contact", "alignment", "all")
Mass = dict[str, list[float]]
"""By group of tokens, ``asked``, then the modalities: share of the attention in each layer; sums to 1 over groups."""


@dataclass(frozen=True)
class Attention:
    """Attention mass, mean over heads and frames.

    Attributes:
        tokens: Share of the tokens that each group has: the mass if all tokens were looked at alike.
        mass: By token that looks (``contact``, ``alignment``, or the mean of ``all``).
        mass_contact: Likewise, of frames in contact; None if there are none.
        mass_free: Likewise, of frames free of contact.
    """

    tokens: dict[str, float]
    mass: dict[str, Mass]
    mass_contact: dict[str, Mass] | None
    mass_free: dict[str, Mass] | None


@torch.no_grad()
def looks(encoder: VTTEncoder, parts: Parts) -> Tensor:
    """How much the token of contact, that of alignment and all on average look at each token.

    Args:
        encoder: In eval mode.
        parts: Of F frames.

    Returns:
        Mean over heads, shape (F, layers, 3, N), in the order of `LOOKERS`; each row sums to 1.
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
    """Sum attention over the tokens of each modality.

    Args:
        looked: Of `looks`.
        parts: The same ones.
        contact: Whether a frame is in contact, shape (F,), bool.
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
    """Where in the image the contact token looks in the last layer.

    Args:
        looked: Of `looks`.
        patches: Tokens of the image, a square number.

    Returns:
        Share of all attention on each patch, row by row, shape (F, side, side).
    """
    side = round(patches**0.5)
    return looked[:, -1, 0, ASKED : ASKED + patches].unflatten(1, (side, side))
