"""Sizes of the networks: that of the paper, and smaller ones that a laptop can train."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Widths:
    """Numbers of units of each part of a network.

    A unit is a regular field (8 channels for D4) or, in the CNN baseline, one channel.

    Attributes:
        vision: Numbers of units after the first six convolutions of the vision encoder.
        force: Number of units per wrench reading in the force encoder.
        heads: Number of attention heads of the force encoder, which divides `force`.
        proprio: Numbers of units after the first three layers of the proprioception encoder.
        latent: Number of units of the output of each encoder and of the fusion.
    """

    vision: tuple[int, int, int, int, int, int]
    force: int
    heads: int
    proprio: tuple[int, int, int]
    latent: int


PRESETS = {
    "tiny": {
        "svfl": Widths((1, 1, 2, 4, 8, 4), force=4, heads=1, proprio=(2, 2, 4), latent=4),
        "cnn": Widths((2, 2, 4, 9, 18, 9), force=11, heads=1, proprio=(5, 5, 10), latent=11),
    },
    "default": {
        "svfl": Widths((1, 2, 4, 8, 16, 8), force=8, heads=2, proprio=(2, 4, 8), latent=8),
        "cnn": Widths((2, 4, 9, 18, 37, 18), force=22, heads=2, proprio=(6, 11, 23), latent=22),
    },
    "wide": {
        "svfl": Widths((2, 4, 8, 16, 32, 16), force=16, heads=4, proprio=(4, 8, 16), latent=16),
        "cnn": Widths((4, 9, 18, 37, 74, 37), force=44, heads=4, proprio=(11, 23, 45), latent=44),
    },
    # The reference implementation at z = 64 (Kohler et al., CoRL 2023), which has 2.3e6 parameters for V+F.
    "paper": {
        "svfl": Widths((8, 16, 32, 64, 128, 64), force=32, heads=8, proprio=(16, 32, 64), latent=64),
        "cnn": Widths((18, 37, 74, 148, 294, 146), force=90, heads=9, proprio=(45, 90, 180), latent=174),
    },
}
"""Sizes by name of the preset and kind of network. Each ``cnn`` baseline has as many parameters as the D4 network of
its preset (``svfl``), within 10 %; tests check this."""
