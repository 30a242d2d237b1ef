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
from svfl_models.latent.networks.portion import Portion
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

    def terms(self, network: LatentNetwork, batch: Batch, portion: Portion | None = None) -> dict[str, Term]:
        """Compute all terms of positive weight.

        Args:
            network: The latent model.
            batch: A batch of `data.Sequences`.
            portion: Sequences of the batch that this process computes; None for all. The terms of portions, weighted
                by their numbers of sequences, have the terms of the batch as their mean.

        Returns:
            Terms by name, in the order of `config.TERMS`.
        """
        whole = len(batch["episode"])
        portion = portion or Portion(0, whole, whole)
        own = {name: values[portion.start : portion.stop] for name, values in batch.items()}
        seen = network(own, portion)
        found = {
            **self._pictures(network, batch, own, seen, portion),
            **self._divergences(seen),
            **self._next_step(network, own, seen),
            **self._pairs(network, batch, own, seen, portion),
        }
        return {name: found[name] for name in TERMS if name in found and self._counts(name)}

    def weighted(self, name: str, term: Term) -> Tensor:
        """Return what the term called `name` adds to the loss, a scalar."""
        return self.weights[name] * (term.elements if name in self.summed else 1) * term.mean

    def _counts(self, *names: str) -> bool:
        return any(self.weights.get(name, 0) > 0 for name in names)

    def _pictures(
        self, network: LatentNetwork, batch: Batch, own: Batch, seen: LatentOutput, portion: Portion
    ) -> dict[str, Term]:
        if not self._counts("image", "depth"):
            return {}
        image = own["image"].flatten(0, 1)
        unit = image.new_tensor([1.0, 1.0, 1.0, DEPTH_UNIT])[:, None, None]
        target = (image - network.inputs.normalization.mean("image")[:, None, None]) / unit
        error = network.decoder(seen.states.state.flatten(0, 1)) - target
        # The backward pass of a split is one concatenation, that of indices takes four passes over the pictures.
        color, depth = error.split([3, 1], dim=1)
        valid = image[:, 3:] > 0
        frames, pixels = own["image"].shape[1], image[0, 0].numel()
        color_nats = _nats(color.square().sum(), color.numel()) / color.numel()
        measured = (batch["image"][:, :, 3] > 0).sum().clamp(min=1)
        depth_nats = _nats((depth * valid).square().sum(), valid.sum()) / measured * portion.scale
        return {"image": Term(color_nats, 3 * frames * pixels), "depth": Term(depth_nats, frames * pixels)}

    def _divergences(self, seen: LatentOutput) -> dict[str, Term]:
        kl = seen.states.posterior.kl(seen.states.prior)
        found = {"kl": Term(kl.mean(), kl[0].numel())}
        if (posterior := seen.encoding.posterior) is not None:
            experts = posterior.kl(Gaussian.standard_like(posterior.mean))
            found["expert_kl"] = Term(experts.mean(), experts[0].numel() * kl.shape[1])
        return found

    def _next_step(self, network: LatentNetwork, own: Batch, seen: LatentOutput) -> dict[str, Term]:
        error = (seen.next_proprio - network.inputs.proprio(own["proprio"][:, 1:])).square()
        return {
            "reward": _entropy(seen.reward, own["reward"]),
            "next_contact": _entropy(seen.next_contact, own["next_contact"]),
            "next_proprio": Term(error.mean(), error[0].numel()),
        }

    def _pairs(
        self, network: LatentNetwork, batch: Batch, own: Batch, seen: LatentOutput, portion: Portion
    ) -> dict[str, Term]:
        frames = own["contact"].shape[1]
        aligned = seen.encoding.alignment.unflatten(0, (-1, frames))
        found = {
            "contact": _entropy(seen.encoding.contact.unflatten(0, (-1, frames)), own["contact"]),
            "alignment": _entropy(aligned, torch.ones_like(aligned)),
        }
        if not self._counts("mismatch"):
            return found
        pairs = mismatched(batch["episode"], batch["step"], batch["touching"], frames, min(self.negatives, frames))
        first, after = (int((pairs.image < frames * end).sum()) for end in (portion.start, portion.stop))
        if first == after:  # without contact in a batch, no pairs of it can be distinguished
            return found | {"mismatch": Term(aligned.sum() * 0, self.negatives)}
        image, wrench = (numbers[first:after] for numbers in (pairs.image, pairs.wrench))
        foreign = {
            name: _wrench_parts(network, batch, seen, portion, wrench)
            if name == "wrench"
            else part[image - frames * portion.start]
            for name, part in seen.parts.items()
        }
        logits = network.encoder.join(foreign, Portion(first, after, len(pairs.image))).alignment
        rejected = functional.softplus(logits).sum() / len(pairs.image) * portion.scale
        return found | {"mismatch": Term(rejected, self.negatives)}


def _wrench_parts(network: LatentNetwork, batch: Batch, seen: LatentOutput, portion: Portion, frames: Tensor) -> Tensor:
    """Return what the encoder makes of the wrenches of frames of the whole batch."""
    if portion.stop - portion.start == portion.whole:
        return seen.parts["wrench"][frames]
    return network.encoder.part("wrench", network.inputs.wrench(batch["wrench"].flatten(0, 1)[frames]))


def _entropy(logits: Tensor, target: Tensor) -> Term:
    return Term(functional.binary_cross_entropy_with_logits(logits, target), logits[0].numel())


def _nats(squares: Tensor, count: Tensor | int) -> Tensor:
    """Return the negative logarithm of the normal density of `count` errors with a sum of squares, [nat]."""
    return 0.5 * squares / SIGMA**2 + count * (math.log(SIGMA) + 0.5 * math.log(2 * math.pi))
