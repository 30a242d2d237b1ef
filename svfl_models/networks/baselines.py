"""The non-symmetric counterpart of `layer_factory.SymmetricLayers`: the same networks, built from ordinary layers."""

from collections.abc import Sequence

from torch import Tensor, nn

from svfl_data.symmetry import Part
from svfl_models.symmetry.groups import GROUPS
from svfl_models.symmetry.representations import components


class PlainLayers:
    """Ordinary convolutions and linear maps; a type is a number of channels.

    Weights start with deviation 1 / sqrt(fan in), which is `layers.initial_deviations` for the trivial group, biases
    at zero.
    """

    group = GROUPS["none"]
    copies = 1

    def image(self, channels: int) -> int:
        """Image channels."""
        return channels

    def vector(self, parts: Sequence[Part]) -> int:
        """Physical components."""
        return components(parts)

    def hidden(self, width: int) -> int:
        """Hidden channels."""
        return width

    def joined(self, types: Sequence[int]) -> int:
        """All channels together."""
        return sum(types)

    def conv(self, source: int, target: int, kernel: int, padding: int) -> nn.Module:
        """Convolution (B, C, H, W) -> (B, C', H', W')."""
        return _initialised(nn.Conv2d(source, target, kernel, padding=padding))

    def linear(self, source: int, target: int) -> nn.Module:
        """Linear map of the last axis."""
        return _initialised(nn.Linear(source, target))

    def scores(self, source: int) -> nn.Module:
        """Linear map of the last axis to four scores."""
        return self.linear(source, 4)


def _initialised(layer: nn.Conv2d | nn.Linear) -> nn.Module:
    fan_in = layer.weight[0].numel()
    nn.init.normal_(layer.weight, std=fan_in**-0.5)
    assert isinstance(layer.bias, Tensor)
    nn.init.zeros_(layer.bias)
    return layer
