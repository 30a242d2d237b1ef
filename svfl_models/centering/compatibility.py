"""Checks that samples fit a trained network: on other units or another camera its output would be meaningless."""

import torch

from svfl_data.errors import TrainingError
from svfl_data.sampling.centering_samples import CenteringSamples
from svfl_models.networks.inputs import INPUTS
from svfl_models.networks.normalization import Normalization

LEAST, MOST = 0.1, 10.0
"""Bounds on the root mean square of a normalised input. It is 1 on the training samples, and within these bounds
samples count as the same kind of data. Other blocks and noises stay within a factor of two; newtons in place of
kilonewtons, or a depth in millimetres, are a factor of 1000."""
GROUPED = {
    "image": {"colour": slice(0, 3), "depth": slice(3, 4)},
    "wrench": {"force": slice(0, 3), "torque": slice(3, 6)},
}
"""Names and indices of the components of each input that share a unit."""


def expect_fit(
    normalization: Normalization, samples: CenteringSamples, encoder: str, checkpoint: object, dataset: object
) -> None:
    """Refuse samples whose scale differs too much from that of the samples a network was trained on.

    Args:
        normalization: Normalization of the network's inputs.
        samples: Samples that the network is to be used on.
        encoder: Inputs of the network, a key of `networks.inputs.INPUTS`: ``v``, ``f``, ``vf`` or ``vfp``.
        checkpoint: Name of the network in the error message.
        dataset: Name of the samples in the error message.

    Raises:
        TrainingError: If the root mean square of a normalised input lies outside `LEAST` to `MOST`.
    """
    for name in (name for name in INPUTS[encoder] if name in GROUPED):
        values = torch.from_numpy(getattr(samples, name))
        normalised = (
            normalization.scaled("image", values).movedim(1, -1)
            if name == "image"
            else normalization.scaled("wrench", values)
        )
        for what, components in GROUPED[name].items():
            size = float(normalised[..., components].square().mean().sqrt())
            if not LEAST <= size <= MOST:
                raise TrainingError(
                    f"{dataset}: the {what} is {size:.3g} times as large as in the training of {checkpoint} "
                    f"(possible: {LEAST:g} to {MOST:g}); its statistics are those of another kind of data"
                )
