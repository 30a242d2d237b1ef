"""Scaling of physical inputs that commutes with the group.

Each representation has one scale, the same for x and y of a vector, and a mean is subtracted from invariants only.
Otherwise normalising a rotated input would not give the rotated normalised input. The statistics come from the training
samples alone. They are buffers of the module, so that a checkpoint contains them.
"""

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor, nn

from svfl_data.errors import TrainingError
from svfl_data.sampling.moments import statistics
from svfl_data.symmetry import Part
from svfl_models.networks.input_types import ImageInput, NetworkInput, paper_inputs


class Normalization(nn.Module):
    """Mean and scale of each input of a network; the identity until `fit` is called.

    Angles are not changed, because they enter a network as the cosine and sine of their double.

    Args:
        inputs: Inputs of the network; by default the paper's image, wrench and proprioception.
    """

    def __init__(self, inputs: Sequence[NetworkInput] = paper_inputs("vfp")) -> None:
        super().__init__()
        self.inputs = {one.name: one for one in inputs}
        for name, one in self.inputs.items():
            count = sum(len(part.index) for part in _parts(one))
            self.register_buffer(f"{name}_mean", torch.zeros(count))
            self.register_buffer(f"{name}_scale", torch.ones(count))

    def fit(self, **values: np.ndarray | None) -> None:
        """Set means and scales to the statistics of the training samples.

        Args:
            values: Physical values of each input by its name: images (S, channels, H, W), windows (S, T, C) or vectors
                (S, C). Inputs that are not given, or are None, keep their means and scales; values of other names are
                ignored.
        """
        for name, given in values.items():
            if given is None or name not in self.inputs:
                continue
            one = self.inputs[name]
            last = np.moveaxis(given, 1, -1) if isinstance(one, ImageInput) else given
            mean, scale = statistics(last, [part for part in _parts(one) if part.kind != "angle"])
            self.mean(name).copy_(torch.from_numpy(mean))
            self.scale(name).copy_(torch.from_numpy(scale))

    def mean(self, name: str) -> Tensor:
        """Return the mean that is subtracted from each component or channel of an input, shape (C,)."""
        return self.get_buffer(f"{name}_mean")

    def scale(self, name: str) -> Tensor:
        """Return the scale that each component or channel of an input is divided by, shape (C,)."""
        return self.get_buffer(f"{name}_scale")

    def scaled(self, name: str, values: Tensor) -> Tensor:
        """Return the normalised values of an input, of the same shape, dimensionless but for angles.

        Args:
            name: Name of the input.
            values: Physical values: images (..., channels, H, W), windows (..., T, C) or vectors (..., C).

        Raises:
            TrainingError: If the network has no such input.
        """
        if name not in self.inputs:
            raise TrainingError(f"no input {name!r}; there are {', '.join(self.inputs)}")
        mean, scale = self.mean(name), self.scale(name)
        if isinstance(self.inputs[name], ImageInput):
            mean, scale = mean[:, None, None], scale[:, None, None]
        return (values - mean) / scale


def _parts(one: NetworkInput) -> Sequence[Part]:
    if isinstance(one, ImageInput):
        return [Part("invariant", (channel,)) for channel in range(one.channels)]
    return one.parts
