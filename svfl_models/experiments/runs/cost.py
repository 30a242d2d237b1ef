"""How long runs take, compared with each other: for their order, and for the time that is left."""

from svfl_models.centering.config import TrainingConfig
from svfl_models.symmetry.groups import GROUPS

IMAGE = 4.0
"""Time of the vision encoder at 64 pixels, in times of the force encoder."""
SMALLEST_IMAGE = 0.5
"""Share of it that is left when there are hardly any pixels."""
PLAIN_ELEMENTS = 3.0
"""Size of the group whose network would be as slow as the parameter-matched CNN baseline."""
LATENT = {"vtt": 200.0, "poe": 50.0, "concat": 50.0}
"""Time of a sample in training a whole latent encoder, with its smaller share of epochs (`latents`)."""
HEAD = 500.0
"""Time of training its head alone."""
EVERY_EPOCH = 10
"""What an epoch costs besides its training samples, in samples."""


def cost(config: TrainingConfig) -> float:
    """About how long a run takes, in arbitrary units.

    The constants are from trainings with the default preset, one thread: 12 epochs of 100 samples took, with V, 2.9 s
    (D4), 6.4 s (D8), 1.2 s (plain) and 1.5 s (D4, 8 pixels); with F, 0.7 s (D4); of 10 samples, with V, 0.5 s (D4).
    """
    if config.latent:
        learns = config.latent.use != "frozen"
        return HEAD + (LATENT[config.latent.model] * (config.train_samples + EVERY_EPOCH) if learns else 0.0)
    pixels = (config.image_size / 64) ** 2
    image = IMAGE * (SMALLEST_IMAGE + (1 - SMALLEST_IMAGE) * pixels) if "v" in config.encoder else 0.0
    force = 1.0 if "f" in config.encoder else 0.0
    elements = PLAIN_ELEMENTS if config.model == "cnn" else len(GROUPS[config.group])
    return (image + force) * elements * (config.train_samples + EVERY_EPOCH)
