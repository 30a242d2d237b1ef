"""The non-symmetric twin of `layers.SymmetricLayers`: the same encoders, built from plain layers."""

from torch import Tensor, nn

from svfl_data.symmetry import Part


class PlainLayers:
    """Ordinary convolutions and linear maps; a type is a number of channels.

    Weights start with deviation 1 / sqrt(fan in), which is `layers.initial_deviations` for the trivial group, biases
    at zero.
    """

    copies = 1

    def image(self, channels: int) -> int:
        """Image channels."""
        return channels

    def vector(self, parts: tuple[Part, ...]) -> int:
        """Physical components."""
        return sum(len(part.index) for part in parts)

    def hidden(self, width: int) -> int:
        """Hidden channels."""
        return width

    def directions(self) -> int:
        """Four scores."""
        return 4

    def conv(self, source: int, target: int, kernel: int, padding: int) -> nn.Module:
        """Convolution (B, C, H, W) -> (B, C', H', W')."""
        return _initialised(nn.Conv2d(source, target, kernel, padding=padding))

    def linear(self, source: int, target: int) -> nn.Module:
        """Linear map of the last axis."""
        return _initialised(nn.Linear(source, target))


def _initialised(layer: nn.Conv2d | nn.Linear) -> nn.Module:
    fan_in = layer.weight[0].numel()
    nn.init.normal_(layer.weight, std=fan_in**-0.5)
    assert isinstance(layer.bias, Tensor)
    nn.init.zeros_(layer.bias)
    return layer
