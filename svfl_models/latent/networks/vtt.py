"""Visuo-tactile transformer: self-attention between patches of the image and pieces of the wrench window."""

import torch
from torch import Tensor, nn
from torch.nn import functional

from svfl_data.errors import TrainingError
from svfl_models.latent.config import Sizes
from svfl_models.latent.inputs import IMAGE_SIZE, PROPRIO, WINDOW
from svfl_models.latent.networks.encoder import SLOPE, Encoder, Encoding, Parts, all_of
from svfl_models.latent.networks.portion import Portion


class VTTEncoder(Encoder):
    """Self-attention over the tokens of one frame (Chen et al., CoRL 2022, with the sizes of the published code).

    The tokens are, in this order: alignment, contact, the image's patches row by row, the wrench window's pieces with
    the oldest first, and proprioception. Each has its own learned position, which also encodes the modality. Frames are
    independent of each other.

    Args:
        sizes: Layer sizes of the networks.

    Raises:
        TrainingError: If the image cannot be divided into patches, or the window into pieces.
    """

    def __init__(self, sizes: Sizes) -> None:
        super().__init__()
        if IMAGE_SIZE % sizes.patch or WINDOW % sizes.readings:
            raise TrainingError(
                f"patches of {sizes.patch} px and pieces of {sizes.readings} readings do not fill an image of "
                f"{IMAGE_SIZE} px and a window of {WINDOW} readings"
            )
        self.readings = sizes.readings
        patches, pieces = (IMAGE_SIZE // sizes.patch) ** 2, WINDOW // sizes.readings
        tokens = 2 + patches + pieces + 1
        self.image = nn.Conv2d(4, sizes.dim, sizes.patch, stride=sizes.patch)
        self.wrench = nn.Linear(sizes.readings * 6, sizes.dim)
        self.proprio = nn.Linear(PROPRIO, sizes.dim)
        self.asked = nn.Parameter(torch.zeros(1, 2, sizes.dim))
        self.position = nn.Parameter(torch.zeros(1, tokens, sizes.dim))
        for table in (self.asked, self.position):
            nn.init.trunc_normal_(table, std=0.02)
        self.blocks = nn.Sequential(*(Block(sizes.dim, sizes.heads) for _ in range(sizes.depth)))
        self.norm = nn.LayerNorm(sizes.dim)
        first, second = sizes.token
        self.reduce = nn.Sequential(
            nn.Linear(sizes.dim, first), nn.LeakyReLU(SLOPE), nn.Linear(first, second), nn.LeakyReLU(SLOPE)
        )
        self.feature = nn.Sequential(
            nn.Linear(tokens * second, sizes.joined), nn.LeakyReLU(SLOPE), nn.Linear(sizes.joined, sizes.feature)
        )
        self.alignment = nn.Linear(sizes.dim, 1)
        self.contact = nn.Linear(sizes.dim, 1)

    def part(self, name: str, values: Tensor) -> Tensor:
        """Return the n tokens of a modality, shape (B, n, D)."""
        if name == "image":
            return self._patches(values)
        layer: nn.Linear = getattr(self, name)
        tokens: Tensor = layer(values.reshape(len(values), -1, layer.in_features))
        return tokens

    def _patches(self, image: Tensor) -> Tensor:
        # The convolution's own backward pass takes ten times as long, because its kernel and stride are 16 pixels.
        size = self.image.stride[0]
        patches = image.unflatten(3, (-1, size)).unflatten(2, (-1, size))  # (B, 4, h, size, w, size)
        flat = patches.permute(0, 2, 4, 1, 3, 5).flatten(3).flatten(1, 2)  # (B, h w, 4 size size)
        return functional.linear(flat, self.image.weight.flatten(1), self.image.bias)

    def join(self, parts: Parts, portion: Portion | None = None) -> Encoding:
        """Apply self-attention to all tokens and compute the outputs from them."""
        tokens = self.norm(self.blocks(self.tokens(parts)))
        return Encoding(
            self.feature(self.reduce(tokens).flatten(1)),
            contact=self.contact(tokens[:, 1])[:, 0],
            alignment=self.alignment(tokens[:, 0])[:, 0],
        )

    def tokens(self, parts: Parts) -> Tensor:
        """Return all N tokens with their positions, the input of the first block, shape (B, N, D)."""
        of_modalities = all_of(parts)
        asked = self.asked.expand(len(of_modalities[0]), -1, -1)
        return torch.cat([asked, *of_modalities], dim=1) + self.position


class Block(nn.Module):
    """Self-attention and a perceptron, each after a layer norm and inside a residual connection.

    Args:
        dim: Length of each token.
        heads: Number of attention heads; it divides `dim`.
    """

    def __init__(self, dim: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        self.first, self.second = nn.LayerNorm(dim, eps=1e-6), nn.LayerNorm(dim, eps=1e-6)
        self.query_key_value = nn.Linear(dim, 3 * dim, bias=False)
        self.out = nn.Linear(dim, dim)
        self.perceptron = nn.Sequential(nn.Linear(dim, 4 * dim), nn.GELU(), nn.Linear(4 * dim, dim))

    def forward(self, x: Tensor) -> Tensor:
        """Map tokens (B, N, D) to tokens of the same shape."""
        query, key, value = self._heads(x)
        mixed = self._weights(query, key) @ value  # Vaswani et al., NeurIPS 2017, equation 1
        x = x + self.out(mixed.transpose(1, 2).flatten(2))  # (B, heads, N, D / heads) -> (B, N, D)
        return x + self.perceptron(self.second(x))

    def attention(self, x: Tensor) -> Tensor:
        """Return the attention of each token to each other one, shape (B, heads, N, N); rows sum to 1."""
        query, key, _ = self._heads(x)
        return self._weights(query, key)

    @staticmethod
    def _weights(query: Tensor, key: Tensor) -> Tensor:
        return (query * query.shape[-1] ** -0.5 @ key.transpose(-2, -1)).softmax(dim=-1)

    def _heads(self, x: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        split = self.query_key_value(self.first(x)).unflatten(-1, (3, self.heads, -1))  # (B, N, 3, heads, D / heads)
        query, key, value = split.permute(2, 0, 3, 1, 4)
        return query, key, value
