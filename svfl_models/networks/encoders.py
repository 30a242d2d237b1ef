"""Encoders of image, force and proprioception, and their fusion, written once for symmetric and plain layers.

The structure is that of Kohler et al. (CoRL 2023, section 4 and appendix), with two published errors corrected:
attention mixes whole fields only, and every reading reaches the output.
"""

import math
from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional

from svfl_data.symmetry import PROPRIO_PARTS, Part
from svfl_models.networks.baselines import PlainLayers
from svfl_models.networks.inputs import IMAGE_SIZES
from svfl_models.networks.layer_factory import Layers, T
from svfl_models.symmetry.representations import stored

IMAGE_CHANNELS = 4
PADDINGS = (1, 1, 1, 1, 1, 0, 0)


class VisionEncoder(nn.Module):
    """Image encoder of seven convolutions, which maps a square image to one feature vector.

    For images of 64 pixels, the sides of the feature maps are 64 -pool- 32 -pool- 16 -pool- 8, 8, 8, 6 -pool- 3, 1.
    Smaller images skip the first poolings, and images of 128 pixels have one more. All sides before a pooling are
    even, because only then does pooling commute with quarter turns.

    Args:
        layers: Layer factory that the encoder is built from.
        widths: Numbers of units after the first six convolutions.
        latent: Number of units of the output.
        size: Height and width of the images, one of `inputs.IMAGE_SIZES`, [px].
        channels: Number of channels of the images.

    Example:
        >>> from svfl_models.networks.layer_factory import layer_factory
        >>> encoder = VisionEncoder(layer_factory(GROUPS["D4"]), widths=(1, 1, 2, 2, 2, 2), latent=4, size=16)
        >>> encoder(torch.randn(2, 4, 16, 16)).shape
        torch.Size([2, 32])
    """

    def __init__(
        self, layers: Layers[T], widths: Sequence[int], latent: int, size: int = 64, channels: int = IMAGE_CHANNELS
    ) -> None:
        super().__init__()
        types = [layers.image(channels), *(layers.hidden(width) for width in (*widths, latent))]
        self.convolutions = nn.ModuleList(
            layers.conv(types[i], types[i + 1], 3, padding) for i, padding in enumerate(PADDINGS)
        )
        self.pooled = {*range(IMAGE_SIZES.index(size)), 5}  # followed by a pooling: `size` to 8, then 6 to 3

    def forward(self, image: Tensor) -> Tensor:
        """Map normalised images, shape (B, channels, size, size), to features, shape (B, C)."""
        x = image.contiguous(memory_format=torch.channels_last)  # this is a quarter faster on a CPU at these widths
        for i, convolution in enumerate(self.convolutions):
            x = convolution(x)
            if i in self.pooled:
                x = functional.max_pool2d(x, 2)  # commutes with the ReLU, which then has a quarter of the pixels
            x = functional.relu(x)
        return x.flatten(1)  # (B, C, 1, 1) -> (B, C)


class InvariantVision(nn.Module):
    """Image encoder for images that do not rotate with the scene, such as those of a camera on the gripper.

    A plain network maps the image to invariants, and a map of the layer factory makes features of them.

    Args:
        layers: Layer factory of the network that the features are for.
        widths: Numbers of units after the first six convolutions, of the plain network.
        latent: Number of units of the output.
        size: Height and width of the images, one of `inputs.IMAGE_SIZES`, [px].
        channels: Number of channels of the images.
    """

    def __init__(self, layers: Layers[T], widths: Sequence[int], latent: int, size: int, channels: int) -> None:
        super().__init__()
        self.vision = VisionEncoder(PlainLayers(), widths, latent, size, channels)
        self.map = layers.linear(layers.vector((Part("invariant", tuple(range(latent))),)), layers.hidden(latent))

    def forward(self, image: Tensor) -> Tensor:
        """Map normalised images, shape (B, channels, size, size), to features, shape (B, C)."""
        return functional.relu(self.map(self.vision(image)))


class SelfAttention(nn.Module):
    """Multi-head scaled dot-product attention between wrench readings, with a residual connection.

    Each head gets whole fields. Its scores are therefore inner products over fields and group elements together, which
    are invariant under the group, and its values keep their field structure.

    Args:
        layers: Layer factory that the attention is built from.
        width: Number of units per reading.
        heads: Number of heads, which must divide `width`.
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
        """Return the features of T readings plus what attention mixes of them, shape (B, T, C) as the input."""
        query, key, value = (self._split(map_(x)) for map_ in (self.query, self.key, self.value))
        mixed = functional.scaled_dot_product_attention(query, key, value)  # Vaswani et al., NeurIPS 2017, equation 1
        return x + self.out(mixed.transpose(1, 2).flatten(2))  # (B, heads, T, C / heads) -> (B, T, C)

    def _split(self, x: Tensor) -> Tensor:
        return x.unflatten(-1, (self.heads, -1)).transpose(1, 2)  # (B, T, C) -> (B, heads, T, C / heads)


class ForceEncoder(nn.Module):
    """Wrench encoder: self-attention over a window of readings, followed by one linear map of the whole window.

    Args:
        layers: Layer factory that the encoder is built from.
        parts: Parts that say how the components of a reading transform, see `representations.wrench_parts`.
        window: Number of readings T in a window.
        width: Number of units per reading.
        heads: Number of attention heads, which must divide `width`.
        latent: Number of units of the output.

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
        """Map normalised windows in image-aligned axes, shape (B, T, C), to features, shape (B, C')."""
        x = functional.relu(self.embed(stored(self.parts, wrench))) + self.position
        x = self.attention(x)
        return functional.relu(self.readout(x.flatten(1)))  # (B, T, fields * copies) -> (B, T * fields * copies)


def position_encoding(window: int, width: int) -> Tensor:
    """Return a sinusoidal code of each reading's place in the window, with one number per unit.

    All group channels of a field are to get the same number: the code is then invariant, and adding it is equivariant.

    Args:
        window: Number of readings T in the window.
        width: Number of units per reading.

    Returns:
        The codes, shape (T, width).

    Source: Vaswani et al., NeurIPS 2017, section 3.5, with wavelengths from 2 pi to the window's length times 2 pi.
    """
    place = torch.arange(window, dtype=torch.float32)[:, None]
    unit = torch.arange(width)
    frequency = torch.exp(-math.log(max(window, 2)) * (unit // 2 * 2) / max(width, 2))
    return torch.where(unit % 2 == 0, torch.sin(place * frequency), torch.cos(place * frequency))


class VectorEncoder(nn.Module):
    """Encoder of a vector, such as proprioception: a four-layer perceptron.

    Args:
        layers: Layer factory that the encoder is built from.
        widths: Numbers of units after the first three layers.
        latent: Number of units of the output.
        parts: Parts of the vector; by default those of proprioception (gripper opening, x, y, z, yaw).

    Example:
        >>> from svfl_models.networks.layer_factory import layer_factory
        >>> VectorEncoder(layer_factory(GROUPS["D4"]), widths=(4, 4, 4), latent=8)(torch.randn(2, 5)).shape
        torch.Size([2, 64])
    """

    def __init__(
        self, layers: Layers[T], widths: Sequence[int], latent: int, parts: tuple[Part, ...] = PROPRIO_PARTS
    ) -> None:
        super().__init__()
        self.parts = parts
        types = [layers.vector(parts), *(layers.hidden(width) for width in (*widths, latent))]
        self.maps = nn.ModuleList(layers.linear(source, target) for source, target in pairwise(types))

    def forward(self, vector: Tensor) -> Tensor:
        """Map normalised vectors to features.

        Args:
            vector: Components, shape (B, C), in image-aligned axes. All but angles are normalised. Positions are
                relative to the centre of the workspace, about which images are rotated. Angles are in [rad].

        Returns:
            Features, shape (B, C).
        """
        x = stored(self.parts, vector)  # yaw x of a two-fingered gripper becomes (cos 2x, sin 2x)
        for linear in self.maps:
            x = functional.relu(linear(x))
        return x


class Fusion(nn.Module):
    """Fusion of the features of all encoders by two linear maps of the concatenated features.

    Args:
        layers: Layer factory that the fusion is built from.
        encoders: Number of encoders.
        latent: Number of units of each encoder's output, and of the fused output.

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
        """Fuse the features of the encoders.

        Args:
            features: Features of each encoder, each of shape (B, C).

        Returns:
            Fused features, shape (B, C).
        """
        x = functional.relu(self.first(torch.cat(list(features), dim=1)))
        return functional.relu(self.second(x))
