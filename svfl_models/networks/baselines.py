"""The non-symmetric counterpart of `layer_factory.SymmetricLayers`, which builds networks from ordinary layers."""

from collections.abc import Sequence

from torch import Tensor, nn

from svfl_data.symmetry import Part
from svfl_models.symmetry.groups import GROUPS
from svfl_models.symmetry.representations import components


class PlainLayers:
    """Factory of ordinary convolutions and linear maps, in which the type of features is their number of channels.

    Initial weights have standard deviation 1 / sqrt(fan in), which is what `kernels.initial_deviations` gives for the
    trivial group. Initial biases are zero.
    """

    group = GROUPS["none"]
    copies = 1

    def image(self, channels: int) -> int:
        """Return the type of an image, which is its number of channels."""
        return channels

    def vector(self, parts: Sequence[Part]) -> int:
        """Return the type of physical components, which is their number as `representations.stored` arranges them."""
        return components(parts)

    def hidden(self, width: int) -> int:
        """Return the type of hidden features of `width` units; one unit is one channel."""
        return width

    def joined(self, types: Sequence[int]) -> int:
        """Return the type of concatenated features, which is the sum of their numbers of channels."""
        return sum(types)

    def conv(self, source: int, target: int, kernel: int, padding: int) -> nn.Module:
        """Return a convolution that maps (B, C, H, W) to (B, C', H', W').

        Args:
            source: Number of input channels C.
            target: Number of output channels C'.
            kernel: Height and width of the kernel, [px].
            padding: Rows and columns of zeros that are added on each side, [px].
        """
        return _initialised(nn.Conv2d(source, target, kernel, padding=padding))

    def linear(self, source: int, target: int) -> nn.Module:
        """Return a linear map of the last axis from `source` to `target` channels."""
        return _initialised(nn.Linear(source, target))

    def scores(self, source: int) -> nn.Module:
        """Return a linear map of the last axis from `source` channels to the scores of the four directions."""
        return self.linear(source, 4)


def _initialised(layer: nn.Conv2d | nn.Linear) -> nn.Module:
    fan_in = layer.weight[0].numel()
    nn.init.normal_(layer.weight, std=fan_in**-0.5)
    assert isinstance(layer.bias, Tensor)
    nn.init.zeros_(layer.bias)
    return layer
