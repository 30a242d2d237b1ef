"""What is left of a model when modalities are missing."""

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
from svfl_models.latent.inputs import Batch
from svfl_models.latent.networks.network import LatentNetwork
from svfl_models.latent.networks.poe import PoEEncoder

SUBSETS = tuple(chosen for count in (3, 2, 1) for chosen in combinations(MODALITIES, count))
"""All seven, the whole first."""


@dataclass(frozen=True)
class Remaining:
    """A model that has only some of the modalities.

    Attributes:
        modalities: Which.
        psnr_db: Of colour, from the posterior states, [dB].
        depth_mae_mm: Of depth, [mm].
        contact_auroc: Of the frame's contact.
        contact_f1: Likewise.
        probe_r2: By target, of probes fitted on features of these modalities alone: what the feature still holds. (A
            probe that was fitted with all of them says nothing sensible when one is gone.)
    """

    modalities: tuple[str, ...]
    psnr_db: float
    depth_mae_mm: float | None
    contact_auroc: float | None
    contact_f1: float | None
    probe_r2: dict[str, float | None]


@torch.no_grad()
def mean_inputs(network: LatentNetwork, frames: Frames) -> Batch:
    """Mean of what encoders read, one of each modality: what stands for a missing one where the model needs all."""
    return {name: values.mean(dim=0) for name, values in network.inputs(frames.observations).items()}


def left(network: LatentNetwork, inputs: Batch, chosen: Sequence[str], mean: Batch) -> Batch:
    """Inputs of which only some modalities are left.

    PoE does without the others; VTT and concat, which need all, get the mean training input in their place.
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
    """Evaluate every subset of the modalities.

    Args:
        network: In eval mode.
        followed: Episodes to evaluate.
        frames: Their frames.
        targets: Of probes, in these frames.
        learned: Training frames, for mean inputs and to fit the probes on.
        learned_targets: Of probes, in those.
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
    """Features, contact logits and states of an episode's frames."""
    inputs = {name: values[0] for name, values in network.inputs(batch).items()}
    encoding = network.encoder(left(network, inputs, chosen, mean))
    states = network.dynamics(encoding.feature[None], network.inputs.action(batch["action"])).state
    return encoding.feature, encoding.contact, states[0]
