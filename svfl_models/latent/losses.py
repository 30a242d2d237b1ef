"""Terms of the loss of latent pretraining, and their weighted sum."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from svfl_data.errors import TrainingError
from svfl_models.latent.config import TERMS
from svfl_models.latent.mismatch import mismatched
from svfl_models.latent.networks.decoder import DEPTH_UNIT
from svfl_models.latent.networks.gaussian import Gaussian
from svfl_models.latent.networks.network import LatentNetwork, LatentOutput
from svfl_models.symmetry.actions import Batch

SIGMA = math.sqrt(0.1)
"""Standard deviation of the normal distribution of images (VTT's published code), in units of the decoder's output."""


@dataclass(frozen=True, eq=False)
class Term:
    """One term of the loss.

    Attributes:
        mean: Mean of the term over all elements that count, a scalar.
        elements: Number of elements per sequence, the factor from the mean to the sum over a sequence.
    """

    mean: Tensor
    elements: int


class Objective:
    """Weighted sum of the terms of the loss.

    - ``image``, ``depth``: negative logarithm of a normal density with fixed deviation, per pixel and channel, [nat];
      pixels without depth do not count.
    - ``kl``: KL divergence of z1's posterior from its prior, per component, [nat].
    - ``expert_kl``: KL divergence of PoE's posterior from N(0, I), per component, [nat]; the other encoders have none.
    - ``reward``: cross-entropy of the prediction whether an action is rewarded; rewards are 0 or 1. The last action of
      an episode counts, because no other action can be rewarded.
    - ``contact``: cross-entropy of the prediction whether the force in a frame exceeds the threshold.
    - ``next_contact``: cross-entropy of the prediction, from state and action, whether there is contact between a frame
      and the next one.
    - ``alignment``, ``mismatch``: cross-entropy of the prediction whether image and wrench belong together, for frames
      with their own wrench and for frames with a foreign one (`mismatch`).
    - ``next_proprio``: squared error of the next proprioception, scaled as by `Inputs`.

    Args:
        weights: Weight of each of `config.TERMS`; a missing term has weight 0.
        summed: Terms that are summed over a sequence; all others are means.
        negatives: Number of frames of each sequence that are shown with another wrench.

    Raises:
        TrainingError: If a name is not one of `config.TERMS`.
    """

    def __init__(self, weights: dict[str, float], summed: Sequence[str], negatives: int = 1) -> None:
        unknown = sorted({*weights, *summed} - set(TERMS))
        if unknown:
            raise TrainingError(f"no term {', '.join(unknown)}; there are {', '.join(TERMS)}")
        self.weights, self.summed, self.negatives = weights, set(summed), negatives

    def terms(self, network: LatentNetwork, batch: Batch) -> dict[str, Term]:
        """Compute all terms of positive weight.

        Args:
            network: The latent model.
            batch: A batch of `data.Sequences`.

        Returns:
            Terms by name, in the order of `config.TERMS`.
        """
        seen = network(batch)
        made = (self._pictures, self._divergences, self._next_step, self._pairs)
        found = {name: term for make in made for name, term in make(network, batch, seen).items()}
        return {name: found[name] for name in TERMS if name in found and self._counts(name)}

    def weighted(self, name: str, term: Term) -> Tensor:
        """Return what the term called `name` adds to the loss, a scalar."""
        return self.weights[name] * (term.elements if name in self.summed else 1) * term.mean

    def _counts(self, *names: str) -> bool:
        return any(self.weights.get(name, 0) > 0 for name in names)

    def _pictures(self, network: LatentNetwork, batch: Batch, seen: LatentOutput) -> dict[str, Term]:
        if not self._counts("image", "depth"):
            return {}
        image = batch["image"].flatten(0, 1)
        unit = image.new_tensor([1.0, 1.0, 1.0, DEPTH_UNIT])[:, None, None]
        target = (image - network.inputs.normalization.mean("image")[:, None, None]) / unit
        error = network.decoder(seen.states.state.flatten(0, 1)) - target
        color, depth = error.split([3, 1], dim=1)  # its backward pass is one concatenation, that of indices is four passes
        valid = image[:, 3:] > 0
        frames, pixels = batch["image"].shape[1], image[0, 0].numel()
        return {
            "image": Term(_nats(color.square().sum(), color.numel()) / color.numel(), 3 * frames * pixels),
            "depth": Term(_nats((depth * valid).square().sum(), valid.sum()) / valid.sum().clamp(min=1), frames * pixels),
        }

    def _divergences(self, network: LatentNetwork, batch: Batch, seen: LatentOutput) -> dict[str, Term]:
        kl = seen.states.posterior.kl(seen.states.prior)
        found = {"kl": Term(kl.mean(), kl[0].numel())}
        if (posterior := seen.encoding.posterior) is not None:
            experts = posterior.kl(Gaussian.standard_like(posterior.mean))
            found["expert_kl"] = Term(experts.mean(), experts[0].numel() * kl.shape[1])
        return found

    def _next_step(self, network: LatentNetwork, batch: Batch, seen: LatentOutput) -> dict[str, Term]:
        error = (seen.next_proprio - network.inputs.proprio(batch["proprio"][:, 1:])).square()
        return {
            "reward": _entropy(seen.reward, batch["reward"]),
            "next_contact": _entropy(seen.next_contact, batch["next_contact"]),
            "next_proprio": Term(error.mean(), error[0].numel()),
        }

    def _pairs(self, network: LatentNetwork, batch: Batch, seen: LatentOutput) -> dict[str, Term]:
        frames = batch["contact"].shape[1]
        own = seen.encoding.alignment.unflatten(0, (-1, frames))
        found = {
            "contact": _entropy(seen.encoding.contact.unflatten(0, (-1, frames)), batch["contact"]),
            "alignment": _entropy(own, torch.ones_like(own)),
        }
        if not self._counts("mismatch"):
            return found
        pairs = mismatched(batch["episode"], batch["step"], batch["touching"], frames, min(self.negatives, frames))
        if len(pairs.image) == 0:  # a batch without contact has no pairs that can be distinguished
            return found | {"mismatch": Term(own.sum() * 0, self.negatives)}
        foreign = {
            name: numbers[pairs.wrench if name == "wrench" else pairs.image] for name, numbers in seen.parts.items()
        }
        logits = network.encoder.join(foreign).alignment
        return found | {"mismatch": Term(_entropy(logits, torch.zeros_like(logits)).mean, self.negatives)}


def _entropy(logits: Tensor, target: Tensor) -> Term:
    return Term(functional.binary_cross_entropy_with_logits(logits, target), logits[0].numel())


def _nats(squares: Tensor, count: Tensor | int) -> Tensor:
    """Return the negative logarithm of the normal density of `count` errors with a sum of squares, [nat]."""
    return 0.5 * squares / SIGMA**2 + count * (math.log(SIGMA) + 0.5 * math.log(2 * math.pi))
