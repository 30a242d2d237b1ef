"""Sizes of the networks: that of the paper, and smaller ones that a laptop can train."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Annotated, Any

import msgspec

from svfl_data.errors import TrainingError

PRESET_HELP = "named set of values for the network's sizes"
"""Help of the setting `preset` of every program, or its beginning."""
Count = Annotated[int, msgspec.Meta(ge=1, le=512)]
"""A number of units; no layer of `PRESETS` has more than 294."""


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

    vision: tuple[Count, Count, Count, Count, Count, Count]
    force: Count
    heads: Count
    proprio: tuple[Count, Count, Count]
    latent: Count

    def __post_init__(self) -> None:
        if self.force % self.heads:
            raise TrainingError(f"widths: {self.heads} attention heads do not divide the {self.force} fields of force")

    def plain(self) -> dict[str, Any]:
        """Return the sizes as plain values; `Widths.of_plain` restores them."""
        return {name: list(value) if isinstance(value, tuple) else value for name, value in asdict(self).items()}

    @classmethod
    def of_plain(cls, plain: Mapping[str, Any]) -> "Widths":
        """Restore sizes from plain values.

        Raises:
            TrainingError: If they are not the sizes of a network.
        """
        try:
            return msgspec.convert(plain, cls)
        except msgspec.ValidationError as error:
            raise TrainingError(f"widths: {error}") from error

    def fewest_weights(self, kinds: str) -> int:
        """Return a lower bound of the number of weights of a network, for each of whose layers one per pair of units.

        Args:
            kinds: Encoders of the network: ``v`` for images, ``f`` for windows, ``p`` for vectors.
        """
        layers = {"v": self.vision, "f": (self.force, self.force), "p": self.proprio}
        chains = [(*layers[kind], self.latent) for kind in kinds]
        return sum(before * after for chain in chains for before, after in pairwise(chain))


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


def widths_of(preset: str, group: str, changes: Mapping[str, Any] | None = None) -> Widths:
    """Return the sizes of a preset for a group, with some of them replaced.

    Args:
        preset: Name of the preset, a key of `PRESETS`.
        group: Name of the symmetry group; ``none`` is the baseline without symmetry.
        changes: Sizes that differ from the preset's, by name of the attribute of `Widths`.

    Raises:
        TrainingError: If there is no such preset, or the sizes are impossible.
    """
    if preset not in PRESETS:
        raise TrainingError(f"unknown preset {preset!r}; possible: {', '.join(PRESETS)}")
    base = PRESETS[preset]["cnn" if group == "none" else "svfl"]
    return Widths.of_plain(base.plain() | dict(changes or {}))
