"""One network per modality, for the encoders that look at each alone: PoE and concat."""

from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional

from svfl_data.errors import TrainingError
from svfl_models.latent.inputs import WINDOW
from svfl_models.latent.networks.encoder import SLOPE


class ImageTrunk(nn.Module):
    """Five convolutions; sides 64, 31, 14, 6, 2, 1.

    VTT's published one has a last kernel of 3 and was made for 84 pixels, sides 41, 19, 8, 3, 1.

    Args:
        widths: Channels after the first four.
        out: Numbers of the output.
    """

    def __init__(self, widths: Sequence[int], out: int) -> None:
        super().__init__()
        self.convolutions = nn.ModuleList(
            nn.Conv2d(source, target, kernel_size=6, stride=2, padding=1) for source, target in pairwise((4, *widths))
        )
        self.last = nn.Conv2d(widths[-1], out, kernel_size=2)

    def forward(self, image: Tensor) -> Tensor:
        """(B, 4, 64, 64) -> (B, out)."""
        x = image.contiguous(memory_format=torch.channels_last)
        for convolution in self.convolutions:
            x = functional.leaky_relu(convolution(x), SLOPE)
        return self.last(x).flatten(1)


class WrenchTrunk(nn.Module):
    """A tree over the window: each layer joins two neighbours, until one vector is left that has seen every reading.

    Args:
        widths: Units of each layer; so many that the readings of a window become one.
        out: Numbers of the output.

    Raises:
        TrainingError: If the layers do not fit the window.
    """

    def __init__(self, widths: Sequence[int], out: int) -> None:
        super().__init__()
        if 2 ** len(widths) != WINDOW:
            raise TrainingError(f"{len(widths)} layers join {2 ** len(widths)} readings, a window has {WINDOW}")
        self.layers = nn.ModuleList(nn.Linear(2 * source, target) for source, target in pairwise((6, *widths)))
        self.last = nn.Linear(widths[-1], out)

    def forward(self, wrench: Tensor) -> Tensor:
        """(B, 64, 6) -> (B, out)."""
        x = wrench
        for layer in self.layers:
            x = functional.leaky_relu(layer(x.reshape(len(x), x.shape[1] // 2, -1)), SLOPE)  # joins neighbours
        return self.last(x[:, 0])


def perceptron(inputs: int, widths: Sequence[int], out: int) -> nn.Sequential:
    """Linear layers with LeakyReLU between them: (..., inputs) -> (..., out)."""
    hidden = [(nn.Linear(source, target), nn.LeakyReLU(SLOPE)) for source, target in pairwise((inputs, *widths))]
    return nn.Sequential(*(layer for pair in hidden for layer in pair), nn.Linear((inputs, *widths)[-1], out))
