"""Networks for single modalities, for the encoders PoE and concat."""

from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional

from svfl_data.errors import TrainingError
from svfl_models.latent.inputs import WINDOW
from svfl_models.latent.networks.encoder import SLOPE


class ImageTrunk(nn.Module):
    """Five convolutions over an image; the sides of their layers are 64, 31, 14, 6, 2 and 1.

    VTT's published network has a last kernel of 3 and is made for 84 pixels, with sides 41, 19, 8, 3 and 1.

    Args:
        widths: Channels after each of the first four convolutions.
        out: Length of the output vector.
    """

    def __init__(self, widths: Sequence[int], out: int) -> None:
        super().__init__()
        self.convolutions = nn.ModuleList(
            nn.Conv2d(source, target, kernel_size=6, stride=2, padding=1) for source, target in pairwise((4, *widths))
        )
        self.last = nn.Conv2d(widths[-1], out, kernel_size=2)

    def forward(self, image: Tensor) -> Tensor:
        """Map images (B, 4, 64, 64) to vectors (B, out)."""
        x = image.contiguous(memory_format=torch.channels_last)
        for convolution in self.convolutions:
            x = functional.leaky_relu(convolution(x), SLOPE, inplace=True)
        return self.last(x).flatten(1)


class WrenchTrunk(nn.Module):
    """Tree over a wrench window: each layer joins pairs of neighbours, until one vector of all readings is left.

    Args:
        widths: Units of each layer. The number of layers must reduce the readings of a window to one.
        out: Length of the output vector.

    Raises:
        TrainingError: If the number of layers does not fit the window.
    """

    def __init__(self, widths: Sequence[int], out: int) -> None:
        super().__init__()
        if 2 ** len(widths) != WINDOW:
            raise TrainingError(f"{len(widths)} layers join {2 ** len(widths)} readings, a window has {WINDOW}")
        self.layers = nn.ModuleList(nn.Linear(2 * source, target) for source, target in pairwise((6, *widths)))
        self.last = nn.Linear(widths[-1], out)

    def forward(self, wrench: Tensor) -> Tensor:
        """Map wrench windows (B, 64, 6) to vectors (B, out)."""
        x = wrench
        for layer in self.layers:
            x = functional.leaky_relu(layer(x.reshape(len(x), x.shape[1] // 2, -1)), SLOPE)  # joins neighbours
        return self.last(x[:, 0])


def perceptron(inputs: int, widths: Sequence[int], out: int) -> nn.Sequential:
    """Build linear layers with LeakyReLU between them, which map (..., inputs) to (..., out).

    Args:
        inputs: Length of the input vectors.
        widths: Units of each hidden layer.
        out: Length of the output vectors.
    """
    hidden = [(nn.Linear(source, target), nn.LeakyReLU(SLOPE)) for source, target in pairwise((inputs, *widths))]
    return nn.Sequential(*(layer for pair in hidden for layer in pair), nn.Linear((inputs, *widths)[-1], out))
