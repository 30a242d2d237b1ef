"""Encoders of image, force and proprioception, and their fusion, written once for symmetric and plain layers.

Structure of Kohler et al. (CoRL 2023, section 4 and appendix), with the published slips mended: attention mixes whole
fields only, and every reading reaches the output.
"""

import math
from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional

from svfl_data.symmetry import PROPRIO_PARTS, Part
from svfl_models.networks.inputs import IMAGE_SIZES
from svfl_models.networks.layer_factory import Layers, T
from svfl_models.symmetry.representations import stored

IMAGE_CHANNELS = 4
PADDINGS = (1, 1, 1, 1, 1, 0, 0)


class VisionEncoder(nn.Module):
    """Seven convolutions from a square image to one feature vector.

    Sides: 64 -pool- 32 -pool- 16 -pool- 8, 8, 8, 6 -pool- 3, 1; smaller images skip the first poolings, 128 has one
    more. All sizes before a pooling are even, which a pooling needs to commute with quarter turns.

    Args:
        layers: The layer factory to build from.
        widths: Units after the first six convolutions.
        latent: Units of the output.
        size: Height and width of the images, one of `config.IMAGE_SIZES`, [px].

    Example:
        >>> from svfl_models.networks.layer_factory import layer_factory
        >>> encoder = VisionEncoder(layer_factory(GROUPS["D4"]), widths=(1, 1, 2, 2, 2, 2), latent=4, size=16)
        >>> encoder(torch.randn(2, 4, 16, 16)).shape
        torch.Size([2, 32])
    """

    def __init__(self, layers: Layers[T], widths: Sequence[int], latent: int, size: int = 64) -> None:
        super().__init__()
        types = [layers.image(IMAGE_CHANNELS), *(layers.hidden(width) for width in (*widths, latent))]
        self.convolutions = nn.ModuleList(
            layers.conv(types[i], types[i + 1], 3, padding) for i, padding in enumerate(PADDINGS)
        )
        self.pooled = {*range(IMAGE_SIZES.index(size)), 5}  # after these convolutions: from `size` to 8, from 6 to 3

    def forward(self, image: Tensor) -> Tensor:
        """Normalised images (B, 4, size, size) -> features (B, C)."""
        x = image.contiguous(memory_format=torch.channels_last)  # a quarter faster on a CPU at these widths
        for i, convolution in enumerate(self.convolutions):
            x = convolution(x)
            if i in self.pooled:
                x = functional.max_pool2d(x, 2)  # commutes with the ReLU, which then has a quarter of the pixels
            x = functional.relu(x)
        return x.flatten(1)  # (B, C, 1, 1) -> (B, C)


class SelfAttention(nn.Module):
    """Multi-head scaled dot-product attention between readings, with a residual connection.

    A head owns whole fields, so its scores are inner products over fields and group elements together, which are
    invariant, and its values keep their field structure.

    Args:
        layers: The layer factory to build from.
        width: Units per reading.
        heads: Number of heads; must divide the width.
    """

    def __init__(self, layers: Layers[T], width: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        hidden = layers.hidden(width)
        self.query = layers.linear(hidden, hidden)
        self.key = layers.linear(hidden, hidden)
        self.value = layers.linear(hidden, hidden)
        self.out = layers.linear(hidden, hidden)

    def forward(self, x: Tensor) -> Tensor:
        """(B, T, C) -> (B, T, C)."""
        query, key, value = (self._split(map_(x)) for map_ in (self.query, self.key, self.value))
        mixed = functional.scaled_dot_product_attention(query, key, value)  # Vaswani et al., NeurIPS 2017, equation 1
        return x + self.out(mixed.transpose(1, 2).flatten(2))  # (B, heads, T, C / heads) -> (B, T, C)

    def _split(self, x: Tensor) -> Tensor:
        return x.unflatten(-1, (self.heads, -1)).transpose(1, 2)  # (B, T, C) -> (B, heads, T, C / heads)


class ForceEncoder(nn.Module):
    """Self-attention over a window of wrench readings, then one linear map of the whole window.

    Args:
        layers: The layer factory to build from.
        parts: How the six components of a reading transform.
        window: Readings T.
        width: Units per reading.
        heads: Attention heads.
        latent: Units of the output.

    Example:
        >>> from svfl_models.networks.layer_factory import layer_factory
        >>> from svfl_models.symmetry.representations import wrench_parts
        >>> encoder = ForceEncoder(layer_factory(GROUPS["D4"]), wrench_parts(), window=64, width=4, heads=2, latent=8)
        >>> encoder(torch.randn(2, 64, 6)).shape
        torch.Size([2, 64])
    """

    position: Tensor

    def __init__(
        self, layers: Layers[T], parts: tuple[Part, ...], window: int, width: int, heads: int, latent: int
    ) -> None:
        super().__init__()
        self.parts = parts
        self.register_buffer("position", position_encoding(window, width).repeat_interleave(layers.copies, dim=-1))
        self.embed = layers.linear(layers.vector(parts), layers.hidden(width))
        self.attention = SelfAttention(layers, width, heads)
        self.readout = layers.linear(layers.hidden(window * width), layers.hidden(latent))

    def forward(self, wrench: Tensor) -> Tensor:
        """Normalised wrench windows (B, T, 6), image-aligned axes -> features (B, C)."""
        x = functional.relu(self.embed(stored(self.parts, wrench))) + self.position
        x = self.attention(x)
        return functional.relu(self.readout(x.flatten(1)))  # (B, T, fields * copies) -> (B, T * fields * copies)


def position_encoding(window: int, width: int) -> Tensor:
    """Sinusoidal code of a reading's place in the window, one number per unit.

    All group channels of a field get the same number, which makes the code invariant and adding it equivariant.

    Args:
        window: Readings T.
        width: Units.

    Returns:
        Shape (T, width).

    Source: Vaswani et al., NeurIPS 2017, section 3.5, with wavelengths from 2 pi to the window's length times 2 pi.
    """
    place = torch.arange(window, dtype=torch.float32)[:, None]
    unit = torch.arange(width)
    frequency = torch.exp(-math.log(max(window, 2)) * (unit // 2 * 2) / max(width, 2))
    return torch.where(unit % 2 == 0, torch.sin(place * frequency), torch.cos(place * frequency))


class ProprioEncoder(nn.Module):
    """Four-layer perceptron of gripper opening, position and yaw of the gripper.

    Args:
        layers: The layer factory to build from.
        widths: Units after the first three layers.
        latent: Units of the output.

    Example:
        >>> from svfl_models.networks.layer_factory import layer_factory
        >>> ProprioEncoder(layer_factory(GROUPS["D4"]), widths=(4, 4, 4), latent=8)(torch.randn(2, 5)).shape
        torch.Size([2, 64])
    """

    def __init__(self, layers: Layers[T], widths: Sequence[int], latent: int) -> None:
        super().__init__()
        types = [layers.vector(PROPRIO_PARTS), *(layers.hidden(width) for width in (*widths, latent))]
        self.maps = nn.ModuleList(layers.linear(source, target) for source, target in pairwise(types))

    def forward(self, proprio: Tensor) -> Tensor:
        """Normalised proprioception -> features (B, C).

        Args:
            proprio: Shape (B, 5), image-aligned axes: (x, y) relative to the centre of the image's rotations, that of
                the workspace; the yaw in [rad].
        """
        x = stored(PROPRIO_PARTS, proprio)  # the yaw of a two-fingered gripper as cosine and sine of its double
        for linear in self.maps:
            x = functional.relu(linear(x))
        return x


class Fusion(nn.Module):
    """Two 1 x 1 maps over the concatenated features of all encoders.

    Args:
        layers: The layer factory to build from.
        encoders: Number of encoders.
        latent: Units of each encoder, and of the output.

    Example:
        >>> from svfl_models.networks.layer_factory import layer_factory
        >>> Fusion(layer_factory(GROUPS["D4"]), encoders=2, latent=8)([torch.randn(2, 64), torch.randn(2, 64)]).shape
        torch.Size([2, 64])
    """

    def __init__(self, layers: Layers[T], encoders: int, latent: int) -> None:
        super().__init__()
        hidden = layers.hidden(latent)
        self.first = layers.linear(layers.hidden(encoders * latent), hidden)
        self.second = layers.linear(hidden, hidden)

    def forward(self, features: Sequence[Tensor]) -> Tensor:
        """One (B, C) per encoder -> (B, C)."""
        x = functional.relu(self.first(torch.cat(list(features), dim=1)))
        return functional.relu(self.second(x))
