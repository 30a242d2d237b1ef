"""Decoder from a latent state to an image."""

from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional

from svfl_models.latent.config import Sizes
from svfl_models.latent.networks.encoder import SLOPE

DEPTH_UNIT = 0.4
"""Metres of depth per unit of the decoder's output; 0.4 m is the width of a workspace."""


class Decoder(nn.Module):
    """Decoder to colour and depth of 64 x 64 pixels; the sides of its layers are 1, 4, 8, 16, 32 and 64.

    The output has no activation and is relative to the mean of the training images, so that the last layer need not
    learn the mean.

    Args:
        sizes: Layer sizes of the networks.
    """

    def __init__(self, sizes: Sizes) -> None:
        super().__init__()
        widths = sizes.decoder
        self.first = nn.Linear(sizes.z1 + sizes.z2, widths[0] * 16)
        self.layers = nn.ModuleList(
            nn.ConvTranspose2d(source, target, kernel_size=4, stride=2, padding=1)
            for source, target in pairwise((*widths, 4))
        )

    def forward(self, state: Tensor) -> Tensor:
        """Map states (B, Z) to images (B, 4, 64, 64), relative to the mean training image, depth in `DEPTH_UNIT`."""
        x = functional.leaky_relu(self.first(state), SLOPE).unflatten(1, (-1, 4, 4))
        x = x.contiguous(memory_format=torch.channels_last)
        for number, layer in enumerate(self.layers):
            x = layer(x)
            if number + 1 < len(self.layers):
                x = functional.leaky_relu(x, SLOPE, inplace=True)
        return x
