"""Sizes of the networks: what the paper used, and what a laptop trains."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Widths:
    """Units of each part; a unit is a regular field (8 channels for D4) or, in the twin, one channel.

    Attributes:
        vision: After the first six convolutions.
        force: Per reading.
        heads: Attention heads; divides `force`.
        latent: Output of each encoder and of the fusion.
    """

    vision: tuple[int, int, int, int, int, int]
    force: int
    heads: int
    latent: int


PRESETS = {
    # Reference implementation at z = 64 (Kohler et al., CoRL 2023): 2.3e6 parameters for V+F.
    "paper": {
        "svfl": Widths((8, 16, 32, 64, 128, 64), force=32, heads=8, latent=64),
        "cnn": Widths((18, 37, 74, 148, 294, 146), force=90, heads=9, latent=174),
    },
    "default": {
        "svfl": Widths((1, 2, 4, 8, 16, 8), force=8, heads=2, latent=8),
        "cnn": Widths((2, 4, 9, 18, 37, 18), force=22, heads=2, latent=22),
    },
}
