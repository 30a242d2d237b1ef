"""Do samples fit a trained network? One that was trained on other units or another camera answers anything."""

import torch

from svfl_data.errors import TrainingError
from svfl_data.sampling.centering_samples import CenteringSamples
from svfl_models.networks.inputs import INPUTS
from svfl_models.networks.normalization import Normalization

LEAST, MOST = 0.1, 10.0
"""Root mean square of a normalised input, which is 1 on the training samples, that still counts as the same kind of
data. Other blocks and noises stay within a factor of two; newtons in place of kilonewtons, or a depth in millimetres,
are a factor of 1000."""
GROUPED = {
    "image": {"colour": slice(0, 3), "depth": slice(3, 4)},
    "wrench": {"force": slice(0, 3), "torque": slice(3, 6)},
}
"""Components of each input that share a unit."""


def expect_fit(
    normalization: Normalization, samples: CenteringSamples, encoder: str, checkpoint: object, dataset: object
) -> None:
    """Refuse samples for which a network's normalisation was not made.

    Args:
        normalization: Of the network.
        samples: What it is to be used on.
        encoder: What it looks at: ``v``, ``f`` or ``vf``.
        checkpoint: What to call the network in the message.
        dataset: What to call the samples.

    Raises:
        TrainingError: If an input is, normalised, far from 1 in root mean square.
    """
    for name in (name for name in INPUTS[encoder] if name in GROUPED):
        values = torch.from_numpy(getattr(samples, name))
        normalised = normalization.image(values).movedim(1, -1) if name == "image" else normalization.wrench(values)
        for what, components in GROUPED[name].items():
            size = float(normalised[..., components].square().mean().sqrt())
            if not LEAST <= size <= MOST:
                raise TrainingError(
                    f"{dataset}: the {what} is {size:.3g} times as large as in the training of {checkpoint} "
                    f"(possible: {LEAST:g} to {MOST:g}); its statistics are those of another kind of data"
                )
