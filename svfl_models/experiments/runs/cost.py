"""Relative durations of runs, from which their order and the remaining time are computed.

The unit of all durations here is the time of the force encoder for one training sample in all epochs of a training, per
element of the group.
"""

from svfl_models.centering.config import TrainingConfig
from svfl_models.symmetry.groups import GROUPS

IMAGE = 4.0
"""Duration of the vision encoder at 64 pixels, in multiples of the force encoder's duration."""
SMALLEST_IMAGE = 0.5
"""Share of `IMAGE` that remains for the smallest images."""
PLAIN_ELEMENTS = 3.0
"""Number of elements of the group whose network would be as slow as the parameter-matched CNN baseline."""
LATENT = {"vtt": 200.0, "poe": 50.0, "concat": 50.0}
"""Duration per sample of training a whole latent encoder, by its model. It includes the smaller number of epochs that
such trainings have (`latents.SHARE_OF_EPOCHS`)."""
HEAD = 500.0
"""Duration of training only the head on a latent encoder, for any number of samples."""
EVERY_EPOCH = 10
"""Duration of an epoch without its training samples, in multiples of the duration of a training sample."""


def cost(config: TrainingConfig) -> float:
    """Estimate how long a run takes, in arbitrary units that are the same for all runs.

    The constants are from trainings with the default preset on one thread. 12 epochs of 100 samples took, with V, 2.9 s
    (D4), 6.4 s (D8), 1.2 s (plain) and 1.5 s (D4, 8 pixels); with F, 0.7 s (D4). 12 epochs of 10 samples took, with V,
    0.5 s (D4).

    Args:
        config: Configuration of the run.
    """
    if config.latent:
        learns = config.latent.use != "frozen"
        return HEAD + (LATENT[config.latent.model] * (config.train_samples + EVERY_EPOCH) if learns else 0.0)
    pixels = (config.image_size / 64) ** 2
    image = IMAGE * (SMALLEST_IMAGE + (1 - SMALLEST_IMAGE) * pixels) if "v" in config.encoder else 0.0
    force = 1.0 if "f" in config.encoder else 0.0
    elements = PLAIN_ELEMENTS if config.model == "cnn" else len(GROUPS[config.group])
    return (image + force) * elements * (config.train_samples + EVERY_EPOCH)
