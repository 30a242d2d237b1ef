"""Measures how well a model works if modalities are missing."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import torch
from torch import Tensor

from svfl_models.latent.config import MODALITIES
from svfl_models.latent.evaluation.frames import Followed, Frames, numbers
from svfl_models.latent.evaluation.probing.probes import Probe, Target
from svfl_models.latent.evaluation.reconstruction import fidelity, pictures
from svfl_models.latent.evaluation.scores import auroc, f1, r_squared
from svfl_models.latent.networks.network import LatentNetwork
from svfl_models.latent.networks.poe import PoEEncoder
from svfl_models.symmetry.actions import Batch

SUBSETS = tuple(chosen for count in (3, 2, 1) for chosen in combinations(MODALITIES, count))
"""All seven non-empty subsets of the modalities, starting with the complete one."""


@dataclass(frozen=True)
class Remaining:
    """Scores of a model that is given only some of the modalities.

    Attributes:
        modalities: Names of the modalities that are given.
        psnr_db: Peak signal-to-noise ratio of the colour decoded from the posterior states, [dB].
        depth_mae_mm: Mean absolute error of the depth decoded from the posterior states, [mm]; None without any depth
            measurement.
        contact_auroc: Area under the receiver operating characteristic of the contact of the frame; None if all frames
            have the same truth.
        contact_f1: F1 of the contact of the frame; None if no frame is positive, neither predicted nor true.
        probe_r2: R^2 by target of linear probes that were fitted on features of these modalities alone. It shows what
            the features still hold; a probe that was fitted with all modalities gives no meaningful result when one is
            missing.
    """

    modalities: tuple[str, ...]
    psnr_db: float
    depth_mae_mm: float | None
    contact_auroc: float | None
    contact_f1: float | None
    probe_r2: dict[str, float | None]


@torch.no_grad()
def mean_inputs(network: LatentNetwork, frames: Frames) -> Batch:
    """Return the mean over frames of an encoder's inputs, one per modality, as a substitute for a missing modality."""
    return {name: values.mean(dim=0) for name, values in network.inputs(frames.observations).items()}


def left(network: LatentNetwork, inputs: Batch, chosen: Sequence[str], mean: Batch) -> Batch:
    """Return inputs in which only some modalities are left.

    PoE gets only the chosen modalities. VTT and concat need all modalities and get the mean training input for the
    others.

    Args:
        network: The latent model.
        inputs: Inputs of all modalities, as `Inputs` returns them.
        chosen: Names of the modalities that are left.
        mean: Mean training inputs, as `mean_inputs` returns them.
    """
    if isinstance(network.encoder, PoEEncoder):
        return {name: inputs[name] for name in chosen}
    return {
        name: values if name in chosen else mean[name].expand_as(values).contiguous() for name, values in inputs.items()
    }


@torch.no_grad()
def missing(
    network: LatentNetwork,
    followed: Sequence[Followed],
    frames: Frames,
    targets: Sequence[Target],
    learned: Frames,
    learned_targets: Sequence[Target],
) -> list[Remaining]:
    """Evaluate a model with each subset of the modalities.

    Args:
        network: The latent model, in eval mode.
        followed: Episodes to evaluate.
        frames: All frames of these episodes.
        targets: Targets of the probes in these frames.
        learned: Training frames, for the mean inputs and to fit the probes on.
        learned_targets: Targets of the probes in the training frames.

    Returns:
        One result per subset, in the order of `SUBSETS`.
    """
    original, touched = frames.observations["image"], frames.contact.numpy()
    mean = mean_inputs(network, learned)
    found = []
    for chosen in SUBSETS:
        features, contacts, states = zip(*(_follow(network, one.batch, chosen, mean) for one in followed), strict=True)
        near = fidelity(pictures(network, torch.cat(states)), original)
        contact = torch.cat(contacts).sigmoid().numpy()
        known = network.encoder(left(network, network.inputs(learned.observations), chosen, mean)).feature
        probe = Probe.fit(numbers(known), learned_targets, learned.episode)
        guesses = probe.guesses(numbers(torch.cat(features)), targets)
        found.append(
            Remaining(
                modalities=chosen,
                psnr_db=near.psnr_db,
                depth_mae_mm=near.depth_mae_mm,
                contact_auroc=auroc(contact, touched),
                contact_f1=f1(contact > 0.5, touched),
                probe_r2={
                    target.name: r_squared(guess, target.values) for target, guess in zip(targets, guesses, strict=True)
                },
            )
        )
    return found


def _follow(
    network: LatentNetwork, batch: Mapping[str, Tensor], chosen: Sequence[str], mean: Batch
) -> tuple[Tensor, Tensor, Tensor]:
    """Return the features, contact logits and latent states of the frames of an episode."""
    inputs = {name: values[0] for name, values in network.inputs(batch).items()}
    encoding = network.encoder(left(network, inputs, chosen, mean))
    states = network.dynamics(encoding.feature[None], network.inputs.action(batch["action"])).state
    return encoding.feature, encoding.contact, states[0]
