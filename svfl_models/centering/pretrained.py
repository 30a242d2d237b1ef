"""Builds a classifier on the checkpoint of a latent pretraining."""

import hashlib
from pathlib import Path
from typing import Any

from svfl_data.errors import TrainingError
from svfl_models.centering.classifier import LATENT_INPUTS
from svfl_models.centering.config import Latent, TrainingConfig
from svfl_models.centering.latent_trunk import LatentTrunk
from svfl_models.centering.module import CenteringModule
from svfl_models.latent.checkpoint import load_latent, read_latent
from svfl_models.latent.config import plain
from svfl_models.latent.networks.network import LatentNetwork


def describe(path: Path | str, use: str, learning_rate: float = Latent.learning_rate) -> Latent:
    """Describe a checkpoint of latent pretraining for the configuration of a training that builds on it.

    Args:
        path: A ``checkpoint.ckpt`` that ``svfl-train latent`` has written.
        use: Training of the encoder, one of `config.USES`.
        learning_rate: Learning rate of the encoder at the start, if it is trained.

    Raises:
        FormatError: If the file is not a sound checkpoint of latent pretraining, see `latent.checkpoint.load_latent`.
    """
    load_latent(path)  # refuses a damaged checkpoint before anything is trained
    found = read_latent(Path(path))
    training = found["hyper_parameters"].get("training") or {}
    return Latent(
        checkpoint=str(path),
        sha256=digest(path),
        model=found["hyper_parameters"]["network"]["model"],
        data=training.get("data", "unknown"),
        preset=training.get("preset", "unknown"),
        steps=found["svfl"]["steps"],
        use=use,
        learning_rate=learning_rate,
    )


def settings(latent: Latent, augment: bool = True) -> dict[str, Any]:
    """Return the arguments of `TrainingConfig` that a pretrained encoder requires.

    Args:
        latent: The pretrained encoder.
        augment: Whether training images are to be recoloured. The result is false in any case for a frozen encoder: it
            has never been trained on such colours, and its features are worth less with them.
    """
    return {
        "latent": latent, "encoder": LATENT_INPUTS, "group": "none", "augment": augment and latent.use != "frozen",
    }  # fmt: skip


def digest(path: Path | str) -> str:
    """Return the SHA-256 of a file's content, in hexadecimal digits."""
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def network_of(latent: Latent) -> LatentNetwork:
    """Load the pretrained network that a `Latent` describes.

    Raises:
        FormatError: If the file is missing or is not a sound checkpoint of latent pretraining.
        TrainingError: If the file's content is not the one that was described.
    """
    network = load_latent(latent.checkpoint).network
    if digest(latent.checkpoint) != latent.sha256:
        raise TrainingError(f"{latent.checkpoint} has changed since this training was planned; start it again")
    return network


def module_of(config: TrainingConfig) -> CenteringModule:
    """Build the network of a configuration; only what comes from a pretraining is already trained.

    Args:
        config: Configuration of the run.

    Raises:
        SvflError: If the pretrained checkpoint is missing, damaged or changed, or does not fit the configuration.
    """
    latent = config.latent
    if latent is None:
        return CenteringModule(
            config.network(), config.learning_rate, config.epochs, config.plain(), schedule=config.schedule
        )
    pretrained = network_of(latent)
    network = config.network() | {"latent_network": {"model": latent.model, "sizes": plain(pretrained.sizes)}}
    rate = 0.0 if latent.use == "frozen" else latent.learning_rate
    module = CenteringModule(
        network, config.learning_rate, config.epochs, config.plain(), rate, config.schedule
    )  # fmt: skip
    trunk = module.classifier.trunk
    assert isinstance(trunk, LatentTrunk)
    trunk.take_over(pretrained, weights=latent.use != "from-scratch")
    return module
