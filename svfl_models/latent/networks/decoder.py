"""From a latent state back to the picture."""

from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional

from svfl_models.latent.config import Sizes
from svfl_models.latent.networks.encoder import SLOPE

DEPTH_UNIT = 0.4
"""Metres of depth per unit of the decoder's output: a workspace's width."""


class Decoder(nn.Module):
    """Colour and depth of 64 x 64 pixels; sides 1, 4, 8, 16, 32, 64.

    Its output has no activation and counts from the mean of the training images, so the last layer need not learn it.

    Args:
        sizes: Of the networks.
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
        """(B, Z) -> (B, 4, 64, 64): colour and depth minus their training means, depth in units of `DEPTH_UNIT`."""
        x = functional.leaky_relu(self.first(state), SLOPE).unflatten(1, (-1, 4, 4))
        x = x.contiguous(memory_format=torch.channels_last)
        for number, layer in enumerate(self.layers):
            x = layer(x)
            if number + 1 < len(self.layers):
                x = functional.leaky_relu(x, SLOPE)
        return x
