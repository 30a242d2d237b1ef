"""From the checkpoint of a latent pretraining to the classifier that is built on it."""

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
    """What a training that builds on a checkpoint must know of it.

    Args:
        path: A ``checkpoint.ckpt`` that ``svfl-train latent`` has written.
        use: One of `config.USES`.
        learning_rate: Of the encoder, where it learns.

    Raises:
        FormatError: If it is no such checkpoint, see `latent.checkpoint.load_latent`.
    """
    load_latent(path)  # what is damaged is refused here, before anything is trained
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
    """The settings of a configuration that builds on it.

    Args:
        latent: What it builds on.
        augment: Whether to recolour training images. Not for an encoder that does not learn: it has never seen such
            colours, and with them its features are worth less.
    """
    return {
        "latent": latent, "encoder": LATENT_INPUTS, "group": "none", "augment": augment and latent.use != "frozen",
    }  # fmt: skip


def digest(path: Path | str) -> str:
    """SHA-256 of a file's content."""
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def network_of(latent: Latent) -> LatentNetwork:
    """The pretrained network.

    Raises:
        FormatError: If the checkpoint is none (any more).
        TrainingError: If it is another one than when it was described.
    """
    network = load_latent(latent.checkpoint).network
    if digest(latent.checkpoint) != latent.sha256:
        raise TrainingError(f"{latent.checkpoint} has changed since this training was planned; start it again")
    return network


def module_of(config: TrainingConfig) -> CenteringModule:
    """The network that a configuration asks for, untrained but for what it takes over from a pretraining.

    Raises:
        SvflError: If there is no such pretraining, or the configuration does not fit it.
    """
    latent = config.latent
    if latent is None:
        return CenteringModule(config.network(), config.learning_rate, config.epochs, config.plain())
    pretrained = network_of(latent)
    network = config.network() | {"latent_network": {"model": latent.model, "sizes": plain(pretrained.sizes)}}
    rate = 0.0 if latent.use == "frozen" else latent.learning_rate
    module = CenteringModule(network, config.learning_rate, config.epochs, config.plain(), rate)
    trunk = module.classifier.trunk
    assert isinstance(trunk, LatentTrunk)
    trunk.take_over(pretrained, weights=latent.use != "from-scratch")
    return module
